"""From forces to the axes of ArduSub's mixer, against another implementation of the mixer."""

import numpy as np
import pytest

from auvbench.integrations.ardusub.frames import motors_of
from auvbench.integrations.mavlink.mixer import (
    FORWARD,
    LATERAL,
    NEUTRAL,
    PITCH,
    ROLL,
    THROTTLE,
    YAW,
    Mixer,
    Sticks,
)
from auvbench.vehicles.sheet import load
from tests.mavlink_vehicle import ArduSub, free_port

VEHICLES = ("bluerov2", "bluerov2_heavy")


def error(mixer, vehicle, forces, gain):
    """RMS of the wrench that is missed over that of the wanted one, per axis."""
    wanted = forces @ vehicle.allocation.T
    made = np.array([mixer.wrench(mixer.axes(force, mixer.limits(gain))) for force in forces])
    return np.sqrt(np.mean((made - wanted) ** 2, axis=0) / np.mean(wanted**2, axis=0))


@pytest.mark.parametrize("name", VEHICLES)
def test_moderate_forces_are_reproduced(name):
    vehicle = load(name)
    rng = np.random.default_rng(0)
    # Thrusters of 10 N and more on the average: far from the dead band, and from saturation at full gain.
    forces = rng.uniform(-16.0, 16.0, (40, len(vehicle.units)))
    assert np.max(error(Mixer(motors_of(vehicle)), vehicle, forces, 1.0)) < 0.02


def test_forces_that_cancel_each_other_move_no_motor():
    vehicle = load("bluerov2")
    null = np.linalg.svd(vehicle.allocation)[2][-1]
    mixer = Mixer(motors_of(vehicle))
    axes = mixer.axes(10.0 * null, mixer.limits(1.0))
    assert np.max(np.abs(mixer.wrench(axes))) < 0.2


@pytest.mark.parametrize("gain", [0.25, 1.0])
@pytest.mark.parametrize("name", VEHICLES)
def test_axes_stay_within_the_sticks(name, gain):
    vehicle = load(name)
    mixer = Mixer(motors_of(vehicle), throttle_gain=2.0)
    axes = mixer.axes(vehicle.force(np.ones(len(vehicle.units))), mixer.limits(gain))
    sticks = mixer.sticks(axes, gain)
    assert all(-1000 <= value <= 1000 for value in (sticks.x, sticks.y, sticks.r))
    assert 0 <= sticks.z <= 1000
    assert all(-400 <= value <= 400 for value in (sticks.s, sticks.t))


@pytest.mark.parametrize(
    ("axis", "sticks"),
    [
        (FORWARD, Sticks(x=1000)),
        (LATERAL, Sticks(y=1000)),
        (THROTTLE, Sticks(z=1000)),
        (YAW, Sticks(r=1000)),
        (PITCH, Sticks(s=200)),
        (ROLL, Sticks(t=200)),
    ],
)
def test_the_sticks_of_one_axis_at_half_gain(axis, sticks):
    mixer = Mixer(motors_of(load("bluerov2_heavy")))
    assert mixer.sticks(0.5 * np.eye(6)[axis], 0.5) == sticks
    assert mixer.sticks(np.zeros(6), 0.5) == NEUTRAL


@pytest.mark.slow
@pytest.mark.parametrize("name", VEHICLES)
@pytest.mark.parametrize("gain", [0.5, 1.0])
def test_the_mixer_is_that_of_another_implementation(name, gain):
    other = ArduSub(free_port(), name)
    other.gain, other.parameters["JS_THR_GAIN"] = gain, 0.8
    mixer = Mixer(motors_of(load(name)), throttle_gain=0.8)
    rng = np.random.default_rng(1)
    for axes in rng.uniform(-1.0, 1.0, (50, 6)) * mixer.limits(gain):
        sticks = mixer.sticks(axes, gain)
        theirs = other.motors((sticks.x, sticks.y, sticks.z, sticks.r, sticks.s, sticks.t))
        # A stick is a whole number, and so is a microsecond.
        np.testing.assert_allclose(theirs, mixer.levels(axes), atol=0.02)


@pytest.mark.parametrize("name", VEHICLES)
@pytest.mark.parametrize("axis", range(6))
def test_a_positive_axis_pushes_as_it_is_called(name, axis):
    mixer = Mixer(motors_of(load(name)))
    wrench = mixer.wrench(0.5 * np.eye(6)[axis])
    if axis == PITCH and name == "bluerov2":
        assert not np.any(wrench)
        return
    # Forward, starboard, down of the mixer; forward, port, up of the wrench.
    component, sign = {
        FORWARD: (0, 1),
        LATERAL: (1, -1),
        THROTTLE: (2, 1),
        ROLL: (3, 1),
        PITCH: (4, -1),
        YAW: (5, -1),
    }[axis]
    assert sign * wrench[component] > 0.0


def test_reach_says_what_is_not_steered_and_what_the_gain_takes():
    mixer = Mixer(motors_of(load("bluerov2")))
    full, half = mixer.reach(1.0), mixer.reach(0.5)
    assert full[4] == 0.0
    steered = [0, 1, 2, 5]
    assert np.all(half[steered] < 0.6 * full[steered])
    assert half[3] == full[3]

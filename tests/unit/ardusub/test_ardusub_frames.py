"""ArduSub's motors: a pilot's stick moves the vehicle the way that ArduSub means."""

import copy
import dataclasses

import numpy as np
import pytest

from auvbench.errors import ConfigError
from auvbench.integrations.ardusub.frames import FRAMES, motors_of, t200_force
from auvbench.vehicles import sheet
from tests import configs

BLUEROV2 = ["bluerov2", "bluerov2_realistic_inertia", "bluerov2_wu2018", "bluerov2_gz_sim_8_12"]
HEAVY = ["bluerov2_heavy", "bluerov2_heavy_wu2018"]

# What a stick means (ArduSub: forward, starboard, up, then bank to starboard, bow up, bow to starboard), in the body's axes
# forward, port, up; columns of the factors: roll, pitch, yaw, throttle, forward, lateral.
AXES = {"forward": (4, 0, 1), "lateral": (5, 1, -1), "throttle": (3, 2, 1)}
TURNS = {"roll": (0, 3, 1), "pitch": (1, 4, -1), "yaw": (2, 5, -1)}


def mixed(frame, column, share=0.5):
    """PWM of ArduSub's mixer for one axis: calc_thrust_to_pwm of the share times the factor."""
    return [round(1500 + 400 * share * row[column]) for row in FRAMES[frame].factors] + [1500] * 8


def wrench(name, column):
    vehicle = sheet.load(name)
    motors = motors_of(vehicle)
    return vehicle.allocation @ motors.forces(mixed(motors.frame.name, column), "sheet")


@pytest.mark.parametrize("name", [*BLUEROV2, *HEAVY])
@pytest.mark.parametrize("axis", AXES)
def test_a_stick_pushes_its_way(name, axis):
    column, row, sign = AXES[axis]
    force = wrench(name, column)
    assert force[row] * sign > 20.0
    assert np.abs(np.delete(force[:3], row)).max() < 0.05 * abs(force[row])


@pytest.mark.parametrize(
    ("name", "turn"),
    [(name, turn) for name in BLUEROV2 for turn in ("roll", "yaw")]
    + [(name, turn) for name in HEAVY for turn in TURNS],
)
def test_a_stick_turns_its_way(name, turn):
    column, row, sign = TURNS[turn]
    moments = wrench(name, column)[3:]
    assert moments[row - 3] * sign > 1.0
    assert np.abs(np.delete(moments, row - 3)).max() < 0.1 * abs(moments[row - 3])


def test_the_signs_of_the_two_vehicles():
    six, eight = motors_of(sheet.load("bluerov2")), motors_of(sheet.load("bluerov2_heavy"))
    assert (six.frame.name, six.order, six.signs) == ("vectored", (0, 1, 2, 3, 4, 5), (-1, -1, 1, 1, -1, 1))
    assert (eight.frame.name, eight.order, eight.signs) == ("vectored_6dof", tuple(range(8)), (-1,) * 8)
    assert motors_of(sheet.load("bluerov2_heavy_wu2018")).order == tuple(range(8))


def test_motors_are_found_by_where_they_push_and_not_by_their_names():
    swapped = copy.deepcopy(configs.plain("vehicle=bluerov2_heavy")["vehicle"])
    positions = swapped["actuators"]["thrusters"]["positions"]["value"]
    positions["thruster6"], positions["thruster7"] = positions["thruster7"], positions["thruster6"]
    assert motors_of(sheet.load(swapped)).order == (0, 1, 2, 3, 4, 6, 5, 7)


def test_the_t200_has_its_measured_ends_and_its_dead_band():
    assert t200_force([1100, 1900]) == pytest.approx([-39.90793, 51.43623])
    np.testing.assert_array_equal(t200_force([1472, 1500, 1528]), 0.0)
    assert t200_force([1464, 1536]) == pytest.approx([-0.4, 0.4], abs=0.3)
    assert np.all(t200_force([1464, 1536]) != 0.0)


def test_thrust_is_in_proportion_to_the_voltage():
    assert t200_force(1700, 12.0) == pytest.approx(0.75 * t200_force(1700))


@pytest.mark.parametrize("pulse", [0, 1000, 2000, 65535])
@pytest.mark.parametrize("thrust", ["t200", "sheet"])
def test_without_a_pulse_there_is_no_thrust(pulse, thrust):
    motors = motors_of(sheet.load("bluerov2"))
    np.testing.assert_array_equal(motors.forces([pulse] * 16, thrust), 0.0)


def test_actions_give_the_forces_clipped_to_the_sheet():
    vehicle = sheet.load("bluerov2_heavy")
    motors = motors_of(vehicle)
    pwm = np.array([[1600, 1450, 1700, 1500, 1400, 1480, 1520, 1900]])
    wanted = np.clip(motors.forces(pwm), *vehicle.force_limits.T * 30.62 / 30.4)
    np.testing.assert_allclose(vehicle.force(vehicle.action(motors.forces(pwm))), wanted, atol=2e-3)


def test_fins_and_other_frames_are_refused_by_name():
    with pytest.raises(ConfigError, match="rudder"):
        motors_of(sheet.load("lrauv"))
    with pytest.raises(ConfigError, match="--motors=thruster0,thruster1"):
        motors_of(sheet.load("rexrov"))


def test_more_thrusters_than_ardusub_has_motors_are_refused():
    vehicle = sheet.load("bluerov2")
    with pytest.raises(ConfigError, match="at most 12"):
        motors_of(dataclasses.replace(vehicle, units=vehicle.units * 3))


def test_an_order_can_be_given():
    rexrov = sheet.load("rexrov")
    names = [f"{sign}thruster{i}" for i, sign in zip((4, 5, 6, 7, 0, 1, 2, 3), ["-", ""] * 4, strict=True)]
    motors = motors_of(rexrov, names)
    assert motors.order == (4, 5, 6, 7, 0, 1, 2, 3)
    assert motors.signs == (-1, 1) * 4
    forces = motors.forces([1900] + [1500] * 15, "sheet")
    assert forces[4] == pytest.approx(rexrov.force_limits[4, 0])
    assert np.count_nonzero(forces) == 1


@pytest.mark.parametrize(
    "names", [["thruster1"], ["thruster1"] * 6, [*"abcdef"]], ids=["one", "twice", "unknown"]
)
def test_a_wrong_order_is_refused(names):
    with pytest.raises(ConfigError, match="--motors"):
        motors_of(sheet.load("bluerov2"), names)

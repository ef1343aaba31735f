"""Waves: the functions that the kernel computes itself, the components of a sea, and vehicles in waves against plain NumPy."""

import dataclasses

import numpy as np
import pytest

from auvbench.dynamics import waves
from auvbench.dynamics.layout import COMPONENT
from auvbench.simulators.fossen import FossenSimulator
from auvbench.simulators.openloop import without_actuators
from auvbench.vehicles.reader import sheet_names
from auvbench.vehicles.sheet import load
from tests.reference.fossen import rk4, rotation
from tests.reference.waves import G, Wave, variance, water
from tests.unit.dynamics.test_kernel import N, body_of, random_states
from tests.verification.cases_waves import on

SEA = [Wave(0.3, 1.1, 0.4, 1.0), Wave(0.2, 1.7, -0.9, 4.0), Wave(0.1, 2.5, 2.0, 2.5)]


def test_sine_and_cosine():
    turns = np.random.default_rng(0).uniform(-400.0, 400.0, 20_000)
    got = np.array([waves.sine_cosine(t) for t in [*turns, 0.0, 0.5, -0.5, 7.25]])
    angle = 2 * np.pi * np.array([*turns, 0.0, 0.5, -0.5, 7.25])
    np.testing.assert_allclose(got, np.column_stack([np.sin(angle), np.cos(angle)]), atol=3e-9)


def test_decay_with_depth():
    depth = np.linspace(0.0, waves.DEEPEST, 5001)
    np.testing.assert_allclose([waves.decay(d) for d in depth], np.exp(-depth), rtol=1e-9)
    assert waves.decay(1e6) < 2e-14


@pytest.mark.parametrize("spectrum", waves.GAMMA)
@pytest.mark.parametrize(("height", "period"), [(0.3, 6.3), (1.88, 8.8), (4.0, 7.2)])
def test_the_components_have_the_height_and_the_motion_of_the_sea_at_each_depth(spectrum, height, period):
    found = waves.components(height, period, spectrum, G)
    assert found.shape == (waves.COMPONENTS, 3)
    sea = found.reshape(-1).view(COMPONENT)
    frequency, number, speed = 2 * np.pi * sea["frequency"], 2 * np.pi * sea["turns"], sea["speed"]
    np.testing.assert_allclose(number, frequency**2 / G, rtol=1e-12)
    assert 4.0 * np.sqrt(np.sum((speed / frequency) ** 2 / 2)) == pytest.approx(height, rel=1e-9)
    for depth in (1.0, 2.0, 5.0, 20.0):
        moved = np.sum(speed**2 / 2 * np.exp(-2 * number * depth))
        assert moved == pytest.approx(variance(height, period, waves.GAMMA[spectrum], depth), rel=2e-3)


def test_the_density_of_pierson_and_moskowitz():
    """Alpha g^2 w^-5 exp(-5/4 (w_p / w)^4) with alpha g^2 = 5/16 Hs^2 w_p^4: its integral is Hs^2 / 16."""
    w = np.linspace(0.05, 60.0, 600_001)
    S = waves.density(w, 2.0, 8.0, "pierson_moskowitz")
    assert np.trapezoid(S, w) == pytest.approx(0.25, rel=1e-5)
    assert w[np.argmax(S)] == pytest.approx(2 * np.pi / 8.0, abs=1e-3)


def simulated(vehicle, pose, velocity, seconds, step, current):
    n = len(pose)
    simulator = FossenSimulator(vehicle, n, max_step=step)
    simulator.reset(np.arange(n), pose, velocity)
    simulator.set_current(current)
    simulator.set_waves(on(SEA, n, 7.3))
    simulator.step(np.zeros((n, len(vehicle.units))), seconds)
    return np.hstack([simulator.pose, simulator.velocity])


@pytest.mark.parametrize("name", sheet_names())
def test_a_vehicle_in_waves_and_a_current_is_that_of_plain_numpy(name):
    """The kernel holds the water still for a substep, in its middle: the same motion to second order in the substep."""
    vehicle = without_actuators(load(name))
    pose, velocity = random_states(np.random.default_rng(5))
    pose, velocity = pose[:2], velocity[:2]
    pose[:, 2] -= 6.0
    current = np.array([0.2, -0.1, 0.05])
    body, displaced = body_of(vehicle), vehicle.buoyancy / vehicle.gravity

    def derivative(t, state):
        flow, acceleration = water(SEA, 7.3 + t, state[:3])
        turned = rotation(state[3:7]).T @ acceleration
        force = displaced * turned
        tau = vehicle.M_A[:, :3] @ turned
        tau = tau + np.concatenate([force, np.cross(vehicle.center_of_buoyancy, force)])
        return body.derivative(state, tau, flow + current)

    expected = []
    for i in range(2):
        state = np.concatenate((pose[i], velocity[i]))
        for k in range(125):
            state = rk4(derivative, 0.002 * k, state, 0.002)
        expected.append(state)
    coarse, fine = (
        np.abs(simulated(vehicle, pose, velocity, 0.25, step, current) - expected).max()
        for step in (0.004, 0.002)
    )
    assert coarse < 2e-5
    assert fine < 0.3 * coarse


@pytest.mark.parametrize("name", sheet_names())
def test_a_wave_of_endless_length_and_period_is_a_current(name):
    """Every part of a vehicle feels it as one: hull, off-diagonal added mass, fins."""
    vehicle = load(name)
    pose, velocity = random_states(np.random.default_rng(6))
    command = np.random.default_rng(7).uniform(-0.5, 0.5, (N, len(vehicle.units)))
    sea = waves.on(np.array([[0.0, 0.0, 0.4]]), N)
    sea.rays[:, :, waves.COSINE], sea.rays[:, :, waves.SINE] = 0.6, 0.8
    found = []
    for wavy in (True, False):
        simulator = FossenSimulator(vehicle, N)
        simulator.reset(np.arange(N), pose, velocity)
        simulator.set_current([0.1, 0.0, 0.0] if wavy else [0.34, 0.32, 0.0])
        if wavy:
            simulator.set_waves(sea)
        for _ in range(20):
            simulator.step(command, 0.1)
        found.append(np.hstack([simulator.pose, simulator.velocity]))
    np.testing.assert_allclose(found[0], found[1], rtol=1e-9, atol=1e-9)
    assert np.abs(found[0][:, :2]).max() > 0.1


def test_a_drawn_vehicle_feels_its_own_added_mass_and_volume():
    vehicle = load("bluerov2_heavy")
    by_hand = dataclasses.replace(vehicle, buoyancy=1.05 * vehicle.buoyancy, M_A=1.6 * vehicle.M_A)
    pose, velocity = random_states(np.random.default_rng(8))
    found = []
    for of, scales in ((vehicle, [[1.0, 1.05, 1.0, 1.6, 1.0, 1.0]] * N), (by_hand, None)):
        simulator = FossenSimulator(of, N)
        simulator.reset(np.arange(N), pose, velocity, scales)
        simulator.set_waves(on(SEA, N))
        for _ in range(10):
            simulator.step(np.zeros((N, 8)), 0.1)
        found.append(np.hstack([simulator.pose, simulator.velocity]))
    np.testing.assert_allclose(found[0], found[1], rtol=1e-11, atol=1e-11)


def test_time_goes_on_with_the_steps_and_lanes_do_not_mix():
    vehicle = load("bluerov2")
    pose, velocity = random_states(np.random.default_rng(9))
    together, alone = FossenSimulator(vehicle, 20), FossenSimulator(vehicle, 1)
    together.reset(np.arange(20), np.tile(pose, (4, 1)), np.tile(velocity, (4, 1)))
    alone.reset(np.array([0]), pose[3:4], velocity[3:4])
    sea, own = on(SEA, 20), on(SEA, 1, 2.5)
    sea.time[:] = np.arange(20)
    sea.time[18] = 2.5
    together.set_waves(sea)
    alone.set_waves(own)
    for _ in range(5):
        together.step(np.zeros((20, 6)), 0.1)
        alone.step(np.zeros((1, 6)), 0.1)
    np.testing.assert_array_equal(together.pose[18], alone.pose[0])
    np.testing.assert_allclose(sea.time[[0, 18]], [0.5, 3.0], rtol=1e-12)
    assert not np.array_equal(together.pose[3], together.pose[18]), "the same start at another time"

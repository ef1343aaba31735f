"""`simulator=gazebo` on a running Gazebo: the contract, and the embedded simulator's motions."""

import dataclasses
import signal

import numpy as np
import pytest

from auvbench.dynamics.rigid_body import GZ_SIM_8_12
from auvbench.errors import ConfigError
from auvbench.integrations.gazebo import bindings
from auvbench.integrations.gazebo.simulator import GazeboSimulator
from auvbench.simulators.fossen import FossenSimulator
from auvbench.vehicles.sheet import load

absent = bindings.missing()
pytestmark = [
    pytest.mark.gazebo,
    pytest.mark.skipif(absent is not None, reason=f"Gazebo is not here: {absent}"),
]

BOTH = ("corrected", "published")


@pytest.fixture(scope="module")
def bluerov2():
    return load("bluerov2")


def start(n, seed=0):
    """Poses (n, 7) at random; row i does not depend on n."""
    rng = np.random.default_rng(seed)
    q = rng.normal(size=(50, 4))
    pose = np.column_stack([rng.uniform(-5, 5, (50, 3)), q / np.linalg.norm(q, axis=1, keepdims=True)])
    return pose[:n]


def commands(steps, n, n_u, seed=1):
    return np.random.default_rng(seed).uniform(-1, 1, (steps, 50, n_u))[:, :n]


def flown(simulator, pose, actions, duration=0.1):
    simulator.reset(np.arange(simulator.n), pose, np.zeros((simulator.n, 6)))
    for action in actions:
        simulator.step(action, duration)
    return np.column_stack([simulator.pose, simulator.velocity])


def same_attitude(state):
    """A quaternion and its negative are one attitude."""
    state = state.copy()
    state[:, 3:7] *= np.sign(state[:, 3:4])
    return state


@pytest.mark.parametrize("name", ["bluerov2", "bluerov2_heavy", "rexrov"])
def test_random_motion_is_that_of_the_embedded_simulator(name):
    vehicle = load(name)
    n, steps = 3, 30
    pose, actions = start(n), commands(steps, n, len(vehicle.units))
    embedded = flown(FossenSimulator(vehicle, n, max_step=0.001), pose, actions)
    errors = []
    for step in (0.004, 0.001):
        gazebo = flown(GazeboSimulator(vehicle, n, max_step=step), pose, actions)
        errors.append(np.abs(same_attitude(gazebo) - same_attitude(embedded)).max())
    assert errors[1] < 0.01
    assert errors[1] < 0.5 * errors[0]


def test_published_is_the_embedded_equations_with_the_coriolis_sign_turned(bluerov2):
    from benchmarks.gazebo.cases import embedded, gazebo, mixed

    case = dataclasses.replace(mixed()[0], duration=8.0)
    path, right, wrong = gazebo(case, "published", 0.001), embedded(case), embedded(case, plugin=GZ_SIM_8_12)
    assert np.abs(path.pose - right.pose).max() > 0.2
    assert np.abs(path.pose - wrong.pose).max() < 0.02
    pitch = -2.0 * np.arcsin(-path.pose[-1, 5])
    assert pitch == pytest.approx(-0.235, abs=0.03)  # as measured on a server of its own, shared facts


@pytest.mark.parametrize("hydrodynamics", BOTH)
def test_the_same_commands_give_the_same_bits_in_any_company(bluerov2, hydrodynamics):
    actions, pose = commands(8, 3, 6), start(3)
    first = flown(GazeboSimulator(bluerov2, 3, hydrodynamics=hydrodynamics), pose, actions)
    again = flown(GazeboSimulator(bluerov2, 3, hydrodynamics=hydrodynamics), pose, actions)
    alone = flown(GazeboSimulator(bluerov2, 1, hydrodynamics=hydrodynamics), pose[:1], actions[:, :1])
    assert np.array_equal(first, again)
    assert np.array_equal(first[:1], alone)


@pytest.mark.parametrize("hydrodynamics", BOTH)
def test_reset_resets_everything_and_leaves_the_others_alone(bluerov2, hydrodynamics):
    pose, actions = start(2), commands(12, 2, 6)
    simulator = GazeboSimulator(bluerov2, 2, hydrodynamics=hydrodynamics)
    flown(simulator, pose, actions[:6])
    simulator.reset(np.array([0]), pose[1:], np.zeros((1, 6)))
    assert np.array_equal(simulator.pose[0], pose[1])
    assert not simulator.velocity[0].any()
    for action in actions[6:]:
        simulator.step(action, 0.1)
    # The first began where a fresh one does; the second never noticed.
    fresh = GazeboSimulator(bluerov2, 1, hydrodynamics=hydrodynamics)
    expected = flown(fresh, pose[1:], actions[6:, :1])
    assert np.array_equal(np.column_stack([simulator.pose, simulator.velocity])[:1], expected)
    undisturbed = flown(GazeboSimulator(bluerov2, 2, hydrodynamics=hydrodynamics), pose, actions)
    assert np.array_equal(np.column_stack([simulator.pose, simulator.velocity])[1:], undisturbed[1:])


def test_more_vehicles_than_a_world_holds_do_as_they_would_alone(bluerov2, monkeypatch):
    monkeypatch.setattr("auvbench.integrations.gazebo.simulator.VEHICLES_PER_WORLD", 2)
    pose, actions = start(5), commands(4, 5, 6)
    spread = flown(GazeboSimulator(bluerov2, 5), pose, actions)
    monkeypatch.undo()
    assert np.array_equal(spread, flown(GazeboSimulator(bluerov2, 5), pose, actions))


def test_vehicles_in_one_place_do_not_touch(bluerov2):
    pose = np.repeat(start(1), 2, axis=0)
    actions = commands(6, 1, 6)
    together = flown(GazeboSimulator(bluerov2, 2), pose, np.repeat(actions, 2, axis=1))
    assert np.array_equal(together[0], together[1])
    assert np.array_equal(together[:1], flown(GazeboSimulator(bluerov2, 1), pose[:1], actions))


def test_currents_that_change_with_time_and_depth(bluerov2):
    n = 2
    pose, actions = start(n), commands(20, n, 6)
    currents = np.random.default_rng(5).uniform(-0.3, 0.3, (20, n, 3))
    states = []
    for simulator in (
        FossenSimulator(bluerov2, n, max_step=0.001),
        GazeboSimulator(bluerov2, n, max_step=0.001),
    ):
        simulator.reset(np.arange(n), pose, np.zeros((n, 6)))
        for action, current in zip(actions, currents, strict=True):
            simulator.set_current(current, -current, (0.0, 4.0))
            simulator.step(action, 0.1)
        states.append(same_attitude(np.column_stack([simulator.pose, simulator.velocity])))
    assert np.abs(states[0] - states[1]).max() < 0.01
    with pytest.raises(ConfigError, match="the second depth must be larger"):
        simulator.set_current([0.1, 0.0, 0.0], [0.0, 0.0, 0.0], (3.0, 2.0))


def test_the_published_plugin_takes_a_steady_current(bluerov2):
    simulator = GazeboSimulator(bluerov2, 2, hydrodynamics="published")
    pose, current = start(2), np.array([[0.3, -0.2, 0.0], [0.0, 0.4, 0.1]])
    simulator.reset(np.arange(2), pose, np.zeros((2, 6)))
    simulator.set_current(current)
    simulator.step(np.zeros((2, 6)), 2.0)
    still = flown(GazeboSimulator(bluerov2, 2, hydrodynamics="published"), pose, np.zeros((1, 2, 6)), 2.0)
    assert np.all(np.sum((simulator.pose[:, :3] - still[:, :3]) * current, axis=1) > 0.0)
    with pytest.raises(ConfigError, match="steady in an episode"):
        simulator.set_current(2.0 * current)
    simulator.reset(np.array([0]), pose[:1], np.zeros((1, 6)))
    simulator.set_current(np.array([[0.0, 0.0, 0.0], current[1]]))
    with pytest.raises(ConfigError, match="the same at all depths"):
        simulator.set_current(current, 2.0 * current)


def test_drawn_vehicles_and_dead_thrusters(bluerov2):
    n = 2
    pose, actions = start(n), commands(15, n, 6)
    scales = np.array([[1.2, 1.2, 0.8, 1.3, 0.7, 0.9], [0.8, 0.8, 1.3, 0.6, 1.4, 1.1]])
    states = []
    for simulator in (
        FossenSimulator(bluerov2, n, max_step=0.001),
        GazeboSimulator(bluerov2, n, max_step=0.001),
    ):
        simulator.reset(np.arange(n), pose, np.zeros((n, 6)), scales)
        simulator.effectiveness[1, 2] = 0.0
        for action in actions:
            simulator.step(action, 0.1)
        states.append(same_attitude(np.column_stack([simulator.pose, simulator.velocity])))
        powers = simulator.command_force.copy(), simulator.power.copy()
    assert np.abs(states[0] - states[1]).max() < 0.01
    np.testing.assert_allclose(powers[0], bluerov2.force(actions[-1]))
    np.testing.assert_allclose(powers[1], bluerov2.power(actions[-1]))
    simulator.reset(np.array([1]), pose[1:], np.zeros((1, 6)))
    assert np.all(simulator.effectiveness == 1.0)


def test_steps_of_several_lengths(bluerov2):
    pose, actions = start(1), commands(6, 1, 6)
    states = []
    for simulator in (
        FossenSimulator(bluerov2, 1, max_step=0.001),
        GazeboSimulator(bluerov2, 1, max_step=0.002),
    ):
        simulator.reset(np.array([0]), pose, np.zeros((1, 6)))
        for action, duration in zip(actions, (0.1, 0.04, 0.003, 0.1, 1 / 30, 0.05), strict=True):
            simulator.step(action, duration)
        states.append(same_attitude(np.column_stack([simulator.pose, simulator.velocity])))
    assert np.abs(states[0] - states[1]).max() < 0.005


def test_a_wrench_acts_at_the_body_origin(bluerov2):
    states = []
    for simulator in (
        FossenSimulator(bluerov2, 1, max_step=0.001),
        GazeboSimulator(bluerov2, 1, max_step=0.001),
    ):
        simulator.external_wrench[0] = [5.0, -3.0, 2.0, 1.0, 2.0, -1.5]
        states.append(same_attitude(flown(simulator, start(1), np.zeros((20, 1, 6)))))
    assert np.abs(states[0] - states[1]).max() < 0.005


def test_moving_starts_and_bad_numbers_are_refused(bluerov2):
    simulator = GazeboSimulator(bluerov2, 1)
    with pytest.raises(ConfigError, match="starts vehicles at rest"):
        simulator.reset(np.array([0]), start(1), np.ones((1, 6)))
    with pytest.raises(ConfigError, match="must be at least 1"):
        GazeboSimulator(bluerov2, 0)
    with pytest.raises(ConfigError, match="positive number of seconds"):
        GazeboSimulator(bluerov2, 1, max_step=0.0)
    with pytest.raises(ValueError, match="expected"):
        simulator.step(np.zeros((1, 5)), 0.1)


def test_ctrl_c_stays_with_those_who_asked_for_it(bluerov2):
    before = signal.getsignal(signal.SIGINT)
    simulator = GazeboSimulator(bluerov2, 1)
    flown(simulator, start(1), np.zeros((1, 1, 6)))
    assert signal.getsignal(signal.SIGINT) is before
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    simulator.step(np.zeros((1, 6)), 0.1)


def test_versions_are_known_once_it_runs(bluerov2):
    flown(GazeboSimulator(bluerov2, 1), start(1), np.zeros((1, 1, 6)))
    found = bindings.used()
    assert found["gz-sim8"].startswith("8.")
    assert "dart" in found

"""The embedded simulator: batches, state, current, faults, scales; physics against closed forms."""

import numpy as np
import pytest
from scipy.optimize import brentq

from auvbench.errors import ConfigError
from auvbench.simulators.fossen import FossenSimulator
from auvbench.vehicles.sheet import load


@pytest.fixture(scope="module")
def bluerov2():
    return load("bluerov2")


def flown(vehicle, n, seed=0, steps=20):
    """A batch after some steps from random states; row i does not depend on n."""
    simulator = FossenSimulator(vehicle, n)
    rng = np.random.default_rng(seed)
    size = 5000
    quaternion = rng.normal(size=(size, 4))
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    pose = np.concatenate((rng.uniform(-5, 5, (size, 3)), quaternion), axis=1)
    velocity = rng.uniform(-0.5, 0.5, (size, 6))
    current = rng.uniform(-0.3, 0.3, (size, 3))
    command = rng.uniform(-1, 1, (size, len(vehicle.actuators)))
    simulator.reset(np.arange(n), pose[:n], velocity[:n])
    simulator.set_current(current[:n], 2.0 * current[:n], (1.0, 4.0))
    for _ in range(steps):
        simulator.step(command[:n], 0.04)
    return simulator


def test_a_vehicle_is_the_same_to_the_last_bit_in_any_batch(bluerov2):
    reference = flown(bluerov2, 4999)
    for n in (1, 2, 15, 16, 17, 100):
        other = flown(bluerov2, n)
        assert np.array_equal(other.pose, reference.pose[:n])
        assert np.array_equal(other.velocity, reference.velocity[:n])


@pytest.mark.parametrize("frequency", [10, 25, 55])
def test_substeps_fill_the_step_exactly(bluerov2, frequency):
    simulator = FossenSimulator(bluerov2, 1)
    count = simulator.substeps(1.0 / frequency)
    assert count == {10: 10, 25: 4, 55: 2}[frequency]
    assert 1.0 / frequency / count <= 0.01


def test_terminal_surge(bluerov2):
    # With the reaction of pitch held off by an external moment, surge ends where drag meets thrust.
    simulator = FossenSimulator(bluerov2, 1)
    simulator.external_wrench[0] = [113.14, 0, bluerov2.weight - bluerov2.buoyancy, 0, 0, 0]
    for _ in range(500):
        simulator.step(np.zeros((1, 6)), 0.04)
    linear, quadratic = bluerov2.linear_damping[0], bluerov2.quadratic_damping[0]
    expected = brentq(lambda u: linear * u + quadratic * u * u - 113.14, 0, 5)
    assert expected == pytest.approx(1.495, abs=5e-4)
    assert np.linalg.norm(simulator.velocity[0, :3]) == pytest.approx(expected, rel=0.05)


def test_free_rise(bluerov2):
    simulator = FossenSimulator(bluerov2, 1)
    for _ in range(1000):
        simulator.step(np.zeros((1, 6)), 0.04)
    assert simulator.velocity[0, 2] == pytest.approx(0.15436, abs=1e-5)


def test_drifting_with_the_current_feels_nothing(bluerov2):
    # Neutral, with coincident centres, spinning: no force from water that moves along.
    simulator = FossenSimulator(bluerov2, 1)
    simulator.reset(np.array([0]), np.array([[0, 0, -5, 1, 0, 0, 0]]), np.array([[0.3, -0.2, 0.1, 0, 0, 0]]))
    simulator.set_current(np.array([0.3, -0.2, 0.1]))
    simulator.external_wrench[0, 2] = bluerov2.weight - bluerov2.buoyancy
    for _ in range(100):
        simulator.step(np.zeros((1, 6)), 0.04)
    assert simulator.velocity[0] == pytest.approx([0.3, -0.2, 0.1, 0, 0, 0], abs=1e-12)


def test_a_dead_thruster_gives_nothing_and_a_command_is_clipped(bluerov2):
    healthy, dead = FossenSimulator(bluerov2, 1), FossenSimulator(bluerov2, 1)
    dead.effectiveness[0, 2] = 0.0
    command = np.array([[0.1, 0.2, 0.0, 0.4, 1.0, -1.0]])
    healthy.step(command, 0.04)
    command[0, 2] = 0.7
    command[0, 4:] *= 3.0
    dead.step(command, 0.04)
    assert np.array_equal(healthy.velocity, dead.velocity)
    assert dead.command_force[0] == pytest.approx([4, 8, 28, 16, 40, -40])


def test_power_and_force_are_the_models(bluerov2):
    simulator = FossenSimulator(bluerov2, 3)
    command = np.random.default_rng(1).uniform(-1, 1, (3, 6))
    simulator.step(command, 0.04)
    assert simulator.power == pytest.approx(bluerov2.power(command), rel=1e-12)
    assert simulator.command_force == pytest.approx(bluerov2.force(command), rel=1e-12)


def test_state_dict_resumes_to_the_last_bit(bluerov2):
    first = flown(bluerov2, 5, steps=7)
    first.reset(np.array([1, 3]), first.pose[[1, 3]], first.velocity[[1, 3]], np.full((2, 6), 1.1))
    saved = first.state_dict()
    second = FossenSimulator(bluerov2, 5)
    second.load_state_dict(saved)
    for simulator in (first, second):
        for _ in range(5):
            simulator.step(np.full((5, 6), 0.3), 0.1)
    for name, value in first.state_dict().items():
        assert np.array_equal(value, second.state_dict()[name]), name


def test_scales_change_one_vehicle_and_reset_restores_it(bluerov2):
    simulator = FossenSimulator(bluerov2, 2)
    rest = np.array([[0.0, 0, -5, 1, 0, 0, 0]])
    still = np.zeros((1, 6))
    simulator.reset(np.array([0, 1]), np.repeat(rest, 2, 0), np.zeros((2, 6)))
    simulator.reset(np.array([1]), rest, still, scales=np.array([[1.0, 1.02, 1, 1, 1, 1]]))
    for _ in range(1000):
        simulator.step(np.zeros((2, 6)), 0.04)
    linear, quadratic = bluerov2.linear_damping[2], bluerov2.quadratic_damping[2]
    for scale, w in zip((1.0, 1.02), simulator.velocity[:, 2], strict=True):
        net = scale * bluerov2.buoyancy - bluerov2.weight
        assert linear * w + quadratic * w * w == pytest.approx(net, rel=1e-6)
    simulator.reset(np.array([1]), rest, still)
    fresh = FossenSimulator(bluerov2, 1)
    fresh.reset(np.array([0]), rest, still)
    command = np.full((2, 6), 0.5)
    simulator.step(command, 0.1)
    fresh.step(command[:1], 0.1)
    assert np.array_equal(simulator.velocity[1], fresh.velocity[0])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"n": 0}, "number of vehicles is 0"),
        ({"n": 1, "max_step": 0.0}, "max_step"),
    ],
)
def test_bad_arguments(bluerov2, arguments, message):
    with pytest.raises(ConfigError, match=message):
        FossenSimulator(bluerov2, **arguments)

"""What ArduSub's sensors read, at rest, in motion and while the vehicle is lowered."""

from __future__ import annotations

import numpy as np
import pytest

from auvbench.dynamics.frames import quaternion, rotation
from auvbench.integrations.ardusub.sensors import GRAVITY, Sensors
from auvbench.integrations.ardusub.sitl import _eased
from auvbench.simulators.fossen import FossenSimulator
from auvbench.vehicles import sheet
from tests import configs


def vehicle(angles: tuple[float, float, float]) -> FossenSimulator:
    made = FossenSimulator(sheet.load(configs.training("vehicle=bluerov2_heavy").vehicle), 1)
    made.reset(np.arange(1), np.array([[1.0, 2.0, -5.0, *quaternion(angles)]]), np.zeros((1, 6)))
    return made


def test_a_held_vehicle_feels_gravity_alone() -> None:
    state = Sensors(vehicle((0.3, -0.2, 1.0))).reset()
    np.testing.assert_allclose(np.linalg.norm(state.specific_force), GRAVITY)
    np.testing.assert_allclose(
        rotation(state.quaternion) @ state.specific_force, (0.0, 0.0, -GRAVITY), atol=1e-12
    )
    assert state.position == (2.0, 1.0, 5.0)
    assert state.velocity == (0.0, 0.0, 0.0)


def test_what_the_accelerometer_sums_up_is_the_change_of_velocity() -> None:
    simulator = vehicle((0.1, 0.2, -0.5))
    sensors = Sensors(simulator)
    sensors.reset()
    velocity, dt = np.zeros(3), 1.0 / 400.0
    for _ in range(400):
        simulator.step(np.array([[0.8, -0.3, 0.5, 0.1, 0.9, -0.4, 0.2, 0.6]]), dt)
        state = sensors.read(dt)
        velocity += (rotation(state.quaternion) @ state.specific_force + (0.0, 0.0, GRAVITY)) * dt
    assert np.linalg.norm(velocity) > 0.1
    np.testing.assert_allclose(velocity, state.velocity, atol=1e-9)
    assert state.time == pytest.approx(1.0)


def test_lowering_starts_and_ends_at_rest_with_speed_and_acceleration_of_its_way() -> None:
    shares = np.linspace(0.0, 1.0, 1001)
    way, speed, acceleration = np.array([_eased(share) for share in shares]).T
    assert (way[0], speed[0]) == (0.0, 0.0)
    assert way[-1] == pytest.approx(1.0)
    assert speed[-1] == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(np.gradient(way, shares)[1:-1], speed[1:-1], atol=1e-4)
    np.testing.assert_allclose(np.gradient(speed, shares)[1:-1], acceleration[1:-1], atol=1e-3)

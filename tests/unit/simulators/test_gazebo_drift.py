"""A current in Gazebo: the force that `CurrentForce` adds is what Fossen's equations have and Gazebo's have not."""

import numpy as np
import pytest

from auvbench.dynamics.frames import rotation
from auvbench.dynamics.rigid_body import coriolis
from auvbench.integrations.gazebo.world import CurrentForce
from auvbench.simulators.fossen import FossenSimulator
from auvbench.vehicles.sheet import load


@pytest.mark.parametrize("name", ["bluerov2", "bluerov2_heavy", "rexrov"])
def test_it_is_the_change_of_force_that_the_embedded_simulator_feels(name):
    vehicle = load(name)
    rng = np.random.default_rng(2)
    q = rng.normal(size=4)
    pose = np.concatenate([rng.normal(size=3), q / np.linalg.norm(q)])
    nu = rng.normal(size=6) * [0.8, 0.5, 0.5, 0.4, 0.4, 0.4]
    current = rng.normal(size=3) * 0.4

    def acceleration(water):
        simulator = FossenSimulator(vehicle, 1, max_step=1e-6)
        simulator.reset(np.array([0]), pose[None], nu[None])
        simulator.set_current(water)
        simulator.step(np.zeros((1, len(vehicle.units))), 1e-6)
        return (simulator.velocity[0] - nu) / 1e-6

    felt = vehicle.M @ (acceleration(current) - acceleration(np.zeros(3)))
    drift = CurrentForce(vehicle.M_A, vehicle.linear_damping, vehicle.quadratic_damping)
    np.testing.assert_allclose(drift.wrench(current, rotation(pose[3:]), nu), felt, rtol=1e-4, atol=1e-3)


def test_a_vehicle_that_drifts_along_feels_no_resistance():
    vehicle = load("bluerov2")
    current = np.array([0.3, -0.2, 0.1])
    drift = CurrentForce(vehicle.M_A, vehicle.linear_damping, vehicle.quadratic_damping)
    nu = np.concatenate([current, np.zeros(3)])
    resistance = (
        coriolis(vehicle.M_A, nu) @ nu
        + (vehicle.linear_damping + vehicle.quadratic_damping * np.abs(nu)) * nu
    )
    np.testing.assert_allclose(drift.wrench(current, np.eye(3), nu), resistance)

"""Vehicles that are told newtons move as those that are told commands, to the last bit."""

import numpy as np
import pytest

from auvbench.dynamics.kernel import commanded
from auvbench.simulators.fossen import FossenSimulator, actuator_table
from auvbench.vehicles.physical import PhysicalCommands
from auvbench.vehicles.reader import sheet_names
from auvbench.vehicles.sheet import load

N = 20  # more than one block of the kernel


def computed(vehicle, action):
    """What the curves make of actions, and the force and power that come with it."""
    table, curves = actuator_table(vehicle)
    value, force, power = np.zeros_like(action), np.zeros_like(action), np.zeros(len(action))
    commanded(action, table, curves, value, force, power)
    return value, force, power


@pytest.mark.parametrize("name", sheet_names())
def test_the_same_bits(name):
    vehicle = load(name)
    physical = PhysicalCommands(vehicle)
    told, served = FossenSimulator(vehicle, N), FossenSimulator(physical.model, N)
    thrusters = np.array([unit.kind == "thruster" for unit in vehicle.units])
    rng = np.random.default_rng(0)
    pose = np.zeros((N, 7))
    pose[:, 2], pose[:, 3] = -20.0, 1.0
    for simulator in (told, served):
        simulator.reset(np.arange(N), pose, np.zeros((N, 6)))
    np.testing.assert_array_equal(told.actuators, served.actuators)
    for k in range(20):
        action = rng.uniform(-1.0, 1.0, (N, len(vehicle.units)))
        action[0] = [-1.0, 0.0, 1.0][k % 3]
        value, force, power = computed(vehicle, action)
        told.step(action, 0.1)
        message = physical.quantities(value)
        np.testing.assert_allclose(message[:, thrusters], force[:, thrusters], rtol=1e-15)
        served.step(physical(message), 0.1)
        for which in ("command_force", "power"):
            np.testing.assert_array_equal(
                getattr(told, which), {"command_force": force, "power": power}[which]
            )
        for which in ("pose", "velocity", "actuators", "command_force", "power"):
            np.testing.assert_array_equal(getattr(told, which), getattr(served, which), err_msg=which)


def test_more_than_a_thruster_has_is_what_it_has():
    vehicle = load("bluerov2")
    physical = PhysicalCommands(vehicle)
    np.testing.assert_array_equal(physical.limits, [[-40.0, 40.0]] * 6)
    np.testing.assert_array_equal(physical(np.full((1, 6), 1e6)), physical(np.full((1, 6), 40.0)))

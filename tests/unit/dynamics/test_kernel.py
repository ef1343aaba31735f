"""The compiled equations against the plain NumPy ones of tests/reference, float for float."""

import dataclasses

import numpy as np
import pytest

from auvbench.dynamics.rigid_body import coriolis
from auvbench.simulators.fossen import FossenSimulator
from auvbench.vehicles.reader import sheet_names
from auvbench.vehicles.sheet import load
from tests.reference.fossen import ENU, Body, rk4

STEP = 0.01
N = 5


def body_of(vehicle):
    return Body(
        name=vehicle.name,
        m=vehicle.mass,
        r_g=vehicle.center_of_gravity,
        I_g=vehicle.inertia,
        M_A=vehicle.M_A,
        D_l=vehicle.linear_damping,
        D_q=vehicle.quadratic_damping,
        W=vehicle.weight,
        B=vehicle.buoyancy,
        r_b=vehicle.center_of_buoyancy,
        down=ENU,
        added_coriolis=vehicle.added_mass_coriolis,
        plugin=vehicle.plugin,
    )


def random_states(rng):
    quaternion = rng.normal(size=(N, 4))
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    pose = np.concatenate((rng.uniform(-3, 3, (N, 3)), quaternion), axis=1)
    return pose, rng.uniform(-1, 1, (N, 6))


@pytest.mark.parametrize("name", sheet_names())
def test_kernel_equals_plain_numpy(name):
    """25 steps of RK4 from random states under a wrench and a current that varies with depth."""
    vehicle = dataclasses.replace(load(name), units=(), controllable=())
    rng = np.random.default_rng(5)
    pose, velocity = random_states(rng)
    wrench = rng.uniform(-1, 1, (N, 6)) * vehicle.mass
    top, bottom = rng.uniform(-0.5, 0.5, (2, N, 3))
    simulator = FossenSimulator(vehicle, N, max_step=STEP)
    simulator.reset(np.arange(N), pose, velocity)
    simulator.external_wrench[:] = wrench
    simulator.set_current(top, bottom, (-1.0, 2.0))
    simulator.step(np.zeros((N, 0)), 25 * STEP)

    body = body_of(vehicle)
    for i in range(N):

        def derivative(t, state, i=i):
            fraction = np.clip((1.0 - state[2]) / 3.0, 0.0, 1.0)
            return body.derivative(state, wrench[i], top[i] + fraction * (bottom[i] - top[i]))

        state = np.concatenate((pose[i], velocity[i]))
        for k in range(25):
            state = rk4(derivative, k * STEP, state, STEP)
        np.testing.assert_allclose(simulator.pose[i], state[:7], rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(simulator.velocity[i], state[7:], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("name", ["bluerov2", "rexrov"])
def test_scaled_parameters_are_those_of_a_scaled_vehicle(name):
    vehicle = load(name)
    scales = np.array([[1.1, 1.08, 0.8, 1.3, 0.7, 0.9]])
    by_hand = dataclasses.replace(
        vehicle,
        mass=1.1 * vehicle.mass,
        weight=1.1 * vehicle.weight,
        buoyancy=1.08 * vehicle.buoyancy,
        inertia=0.8 * vehicle.inertia,
        M_A=1.3 * vehicle.M_A,
        linear_damping=0.7 * vehicle.linear_damping,
        quadratic_damping=0.7 * vehicle.quadratic_damping,
    )
    pose, velocity = random_states(np.random.default_rng(8))
    scaled, rebuilt = FossenSimulator(vehicle, 1), FossenSimulator(by_hand, 1)
    scaled.reset(np.array([0]), pose[:1], velocity[:1], scales)
    rebuilt.reset(np.array([0]), pose[:1], velocity[:1])
    rebuilt.effectiveness[:] = 0.9
    command = np.linspace(-0.5, 0.5, len(vehicle.units))[None]
    for simulator in (scaled, rebuilt):
        for _ in range(10):
            simulator.step(command, 0.1)
    np.testing.assert_allclose(scaled.pose, rebuilt.pose, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(scaled.velocity, rebuilt.velocity, rtol=1e-11, atol=1e-11)


def test_coriolis_of_a_diagonal_added_mass():
    """The matrix that gz-sim's unit test of its hydrodynamics prints (section 9.2 of the reference cases)."""
    C = coriolis(np.diag([1.0, 2, 3, 4, 5, 6]), [1.0, 2, 3, 4, 5, 6])
    expected = [
        [0, 0, 0, 0, 9, -4],
        [0, 0, 0, -9, 0, 1],
        [0, 0, 0, 4, -1, 0],
        [0, 9, -4, 0, 36, -25],
        [-9, 0, 1, -36, 0, 16],
        [4, -1, 0, 25, -16, 0],
    ]
    np.testing.assert_array_equal(C, expected)

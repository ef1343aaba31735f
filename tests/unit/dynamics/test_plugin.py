"""The Coriolis term of added mass as Gazebo's Hydrodynamics plugin has it: what was measured and what its source says."""

import dataclasses

import numpy as np
import pytest

from auvbench.dynamics.rigid_body import GZ_SIM_8_11, GZ_SIM_8_12, coriolis, early
from auvbench.simulators.fossen import FossenSimulator
from auvbench.vehicles.sheet import load
from tests.reference.fossen import plugins_matrix

ADDED = np.diag([2.0, 15.0, 15.0, 0.01, 0.5, 0.5])


def sphere(plugin):
    """20 kg, no weight, no drag."""
    vehicle = load("bluerov2")
    return dataclasses.replace(
        vehicle,
        mass=20.0,
        center_of_gravity=np.zeros(3),
        inertia=np.eye(3),
        weight=0.0,
        buoyancy=0.0,
        M_A=ADDED,
        linear_damping=np.zeros(6),
        quadratic_damping=np.zeros(6),
        units=(),
        controllable=(),
        plugin=plugin,
    )


def yaw_moment(plugin, nu):
    h = 1e-6
    simulator = FossenSimulator(sphere(plugin), 1, max_step=h)
    simulator.reset(np.array([0]), [[0, 0, 0, 1, 0, 0, 0]], [nu])
    simulator.step(np.zeros((1, 0)), h)
    return simulator.velocity[0, 5] / h * (1.0 + ADDED[5, 5])


@pytest.mark.parametrize(
    ("plugin", "moment"),
    [
        ("", -2.6),  # -(15 - 2) u v, right
        (GZ_SIM_8_12, 2.6),  # measured on gz-sim 8.14.0
        (GZ_SIM_8_11, -0.4),  # -2 u v, by its source
    ],
)
def test_the_munk_moment_of_a_swaying_vehicle(plugin, moment):
    assert yaw_moment(plugin, [1.0, 0.2, 0.0, 0.0, 0.0, 0.0]) == pytest.approx(moment, rel=1e-4)


def test_the_early_plugin_turns_what_rises_ahead_and_nobody_else_does():
    rising = [1.0, 0.0, 0.2, 0.0, 0.0, 0.0]
    assert yaw_moment("", rising) == yaw_moment(GZ_SIM_8_12, rising) == 0.0
    assert yaw_moment(GZ_SIM_8_11, rising) == pytest.approx(-3.0, rel=1e-4)


@pytest.mark.parametrize("release", [GZ_SIM_8_11, GZ_SIM_8_12])
def test_wrench_is_that_of_the_source_s_matrix(release):
    rng = np.random.default_rng(0)
    for _ in range(20):
        M_A, nu = np.diag(rng.uniform(0.0, 20.0, 6)), rng.normal(size=6)
        wrench = coriolis(M_A, nu) @ nu
        if release == GZ_SIM_8_11:
            wrench = wrench + early(M_A, nu)
        np.testing.assert_allclose(wrench, plugins_matrix(-M_A, nu, release) @ nu, rtol=1e-12, atol=1e-12)
        power = nu @ wrench
        assert (abs(power) < 1e-10) == (release == GZ_SIM_8_12), "the early one does work"

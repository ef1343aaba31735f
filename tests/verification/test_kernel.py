"""The compiled simulator against the plain NumPy reference, number by number, on every vehicle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from auvbench.simulators import openloop
from auvbench.simulators.fossen import FossenSimulator
from auvbench.vehicles.vehicle_model import VehicleModel

from ..reference import actuators
from ..reference.fossen import NED, Array, Wrench, constant, simulate
from ..reference.vehicles import ALL, REXROV_ALLOCATION, THRUSTERS, allocation
from . import rig
from .cases_reference import FLIP, STEP, free_motion, in_flu, other_integrator, relative, starts, states


@pytest.mark.parametrize("name", sorted(ALL))
def test_same_numbers_in_the_sheet(name: str) -> None:
    """Two transcriptions of the sources agree."""
    sheet, body = rig.vehicle(name), in_flu(ALL[name])
    np.testing.assert_allclose(sheet.M_RB, body.M_RB(), rtol=1e-14, atol=1e-14)
    np.testing.assert_allclose(sheet.M_A, body.M_A, rtol=1e-14)
    np.testing.assert_array_equal(sheet.linear_damping, body.D_l)
    np.testing.assert_array_equal(sheet.quadratic_damping, body.D_q)
    assert sheet.weight == pytest.approx(body.W, rel=1e-14)
    assert sheet.buoyancy == pytest.approx(body.B, rel=1e-14)
    np.testing.assert_allclose(sheet.center_of_gravity, body.r_g, atol=1e-15)
    np.testing.assert_allclose(sheet.center_of_buoyancy, body.r_b, atol=1e-15)
    assert sheet.added_mass_coriolis == body.added_coriolis


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(ALL))
def test_free_motion_in_a_current(name: str) -> None:
    assert free_motion(name) < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(ALL))
def test_against_an_integrator_of_another_kind(name: str) -> None:
    assert other_integrator(name) < 1e-7


@pytest.mark.parametrize("name", sorted(THRUSTERS))
def test_allocation(name: str) -> None:
    expected = allocation(name)
    if ALL[name].down == NED:
        expected = expected * FLIP[:, None]
    np.testing.assert_allclose(rig.vehicle(name).allocation, expected, atol=2e-9)


def test_allocation_of_rexrov() -> None:
    np.testing.assert_allclose(rig.vehicle("rexrov").allocation, REXROV_ALLOCATION, atol=1e-6)


def lagged(force: Array, t: float, tau: float) -> Array:
    return force * (1 - np.exp(-t / tau))


def third_order(force: Array, t: float) -> Array:
    """Step response of (6136 s + 108700) / (s^3 + 89 s^2 + 9258 s + 108700), times `force`."""
    A = np.array([[0.0, 1, 0, 0], [0, 0, 1, 0], [-108700, -9258, -89, 1], [0, 0, 0, 0]])
    x = expm(A * t) @ np.array([0.0, 0, 0, 1])
    return force * (108700 * x[0] + 6136 * x[1])


def thrust_wrench(name: str, sheet: VehicleModel, action: Array) -> Wrench:
    """The wrench of the thrusters over time after a step of the commands, from textbook expressions."""
    B = sheet.allocation  # compared with its own transcription above
    if name.startswith("bluerov2_heavy_wu"):
        force = sheet.force(action)  # the T200 table, compared with the published points in the cases
        return lambda t, y: B @ lagged(force, t, 0.2)
    if name == "bluerov2_heavy":
        force = actuators.von_benzon_curve(action)
        return lambda t, y: B @ third_order(force, t)
    if name == "rexrov":
        rotor = 2540.0 * action
        return lambda t, y: B @ (0.00031 * lagged(rotor, t, 0.05) * np.abs(lagged(rotor, t, 0.05)))
    return lambda t, y: B @ (40.0 * action)


@pytest.mark.parametrize(
    "name", ["bluerov2", "bluerov2_wu2018", "bluerov2_heavy", "bluerov2_heavy_wu2018", "rexrov"]
)
def test_thrusters(name: str) -> None:
    """Static curve, lag and allocation while the vehicle moves: the stages of RK4 see the exact thrust."""
    sheet, body = rig.vehicle(name), in_flu(ALL[name])
    action = np.random.default_rng(5).uniform(-0.9, 0.9, len(sheet.actuators))
    pose, velocity = starts(1, seed=2)
    simulator = FossenSimulator(sheet, 1, max_step=STEP)
    simulator.reset(np.array([0]), pose, velocity)
    for _ in range(5):
        simulator.step(action[None], 0.1)
    expected = simulate(
        body,
        np.concatenate([pose[0], velocity[0]]),
        np.array([0.0, 0.5]),
        thrust_wrench(name, sheet, action),
        step=STEP,
    )[-1]
    assert relative(states(simulator)[0], expected) < 1e-12


def test_fins_propeller_and_engine() -> None:
    """The LRAUV with everything in motion, in a current."""
    sheet, body = rig.vehicle("lrauv"), ALL["lrauv"]
    current = np.array([0.1, 0.3, -0.05])
    physical = {"propeller": 30.0, "rudder": -0.15, "elevator": 0.2, "buoyancy_engine": 500e-6 + 3e-6}
    n_steps = 50
    state = np.concatenate([[0, 0, -5, 1, 0, 0, 0], [0.8, 0.1, -0.05, 0.02, 0.03, 0.1]])
    simulator = FossenSimulator(sheet, 1, max_step=0.02)
    simulator.reset(np.array([0]), state[None, :7], state[None, 7:])
    simulator.set_current(current)
    simulator.step(rig.command(sheet, **physical)[None], n_steps * 0.02)

    def wrench(t: float, y: Array) -> Array:
        return actuators.tethys(
            30.0,
            -0.15,
            0.2,
            min(3e-6 * t, 3e-6),
            nu=y[7:],
            q=y[3:7],
            current=current,
        )

    expected = simulate(body, state, np.array([0.0, n_steps * 0.02]), wrench, current, step=0.02)[-1]
    assert relative(states(simulator)[0], expected) < 1e-12


@pytest.mark.parametrize("name", ["bluerov2", "rexrov", "lrauv"])
def test_same_floats_at_any_batch_size(name: str) -> None:
    sheet = rig.vehicle(name)
    n = 37
    pose, velocity = starts(n, seed=4)
    action = np.random.default_rng(6).uniform(-1, 1, (n, len(sheet.actuators)))
    together = FossenSimulator(sheet, n)
    together.reset(np.arange(n), pose, velocity)
    together.step(action, 0.5)
    for i in (0, 15, 16, 36):
        alone = FossenSimulator(sheet, 1)
        alone.reset(np.array([0]), pose[i : i + 1], velocity[i : i + 1])
        alone.step(action[i : i + 1], 0.5)
        assert np.array_equal(states(alone)[0], states(together)[i])


@pytest.mark.parametrize("name", ["bluerov2", "rexrov"])
def test_current_that_varies_with_depth(name: str) -> None:
    """Linear between two depths, constant above and below; the vehicle sinks through all three."""
    sheet, body = openloop.without_actuators(rig.vehicle(name)), in_flu(ALL[name])
    top, bottom = np.array([0.5, -0.2, 0.0]), np.array([-0.3, 0.4, 0.1])
    simulator = FossenSimulator(sheet, 1, max_step=STEP)
    start = np.concatenate([[0, 0, -1.8, 1, 0, 0, 0], [0.3, 0, -1.0, 0, 0, 0.3]])
    simulator.reset(np.array([0]), start[None, :7], start[None, 7:])
    simulator.set_current(top, bottom, (2.0, 2.5))
    wrench = np.array([0, 0, -30.0, 0, 0, 0]) * sheet.mass / 15
    simulator.external_wrench[0] = wrench
    simulator.step(np.zeros((1, 0)), 1.5)

    def current(z: float) -> Array:
        return top + np.clip((-z - 2.0) / 0.5, 0, 1) * (bottom - top)

    expected = simulate(body, start, np.array([0.0, 1.5]), constant(wrench), current, step=STEP)[-1]
    assert expected[2] < -2.5
    assert relative(states(simulator)[0], expected) < 1e-12


def test_domain_randomisation() -> None:
    """Scales of mass, buoyancy, inertia, added mass, damping and thrust are those of the sheet's numbers."""
    sheet, body = rig.vehicle("bluerov2"), ALL["bluerov2"]
    rng = np.random.default_rng(9)
    scales = rng.uniform(0.7, 1.3, (3, 6))
    pose, velocity = starts(3, seed=10)
    action = rng.uniform(-1, 1, (3, 6))
    simulator = FossenSimulator(sheet, 3, max_step=STEP)
    simulator.reset(np.arange(3), pose, velocity, scales)
    simulator.effectiveness[:] = rng.uniform(0, 1, (3, 6))
    simulator.step(action, 0.5)
    for i, (mass, buoyancy, inertia, added, damping, thrust) in enumerate(scales):
        scaled = replace(
            body,
            m=mass * body.m,
            W=mass * body.W,
            B=buoyancy * body.B,
            I_g=inertia * body.I_g,
            M_A=added * body.M_A,
            D_l=damping * body.D_l,
            D_q=damping * body.D_q,
        )
        tau = allocation("bluerov2") @ (40.0 * action[i] * thrust * simulator.effectiveness[i])
        start = np.concatenate([pose[i], velocity[i]])
        expected = simulate(scaled, start, np.array([0.0, 0.5]), constant(tau), step=STEP)[-1]
        # The sheet's directions have eight digits, the transcription's all.
        assert relative(states(simulator)[i], expected) < 1e-8

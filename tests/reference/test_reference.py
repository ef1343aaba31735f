"""The reference itself against numbers that others published: a yardstick must be measured too."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from . import actuators
from .fossen import (
    ENU,
    NED,
    Array,
    Body,
    as_csv,
    constant,
    coriolis_of,
    quaternion,
    rotation,
    simulate,
    state_at,
)
from .vehicles import BLUEROV2, LRAUV, REXROV, VON_BENZON, WU2018, allocation

DATA = Path(__file__).parent.parent / "verification" / "data"

TRAJECTORIES = [
    # file, vehicle, wrench, usable until s
    ("vonbenzon_surge40N", VON_BENZON, (40, 0, 0, 0, 0, 0), 12),
    ("vonbenzon_heave_down40N", VON_BENZON, (0, 0, 40, 0, 0, 0), 20),
    ("vonbenzon_yaw2Nm", VON_BENZON, (0, 0, 0, 0, 0, 2), 20),
    ("vonbenzon_roll_release_20deg", VON_BENZON, (0, 0, 0, 0, 0, 0), 20),
    ("wu2018_sway40N", WU2018, (0, 40, 0, 0, 0, 0), 20),
    ("wu2018_yaw2Nm", WU2018, (0, 0, 0, 0, 0, 2), 20),
    ("wu2018_free_float", WU2018, (0, 0, 0, 0, 0, 0), 60),
]


@pytest.mark.slow
@pytest.mark.parametrize(("file", "body", "wrench", "until"), TRAJECTORIES, ids=[t[0] for t in TRAJECTORIES])
def test_published_trajectories(file: str, body: Body, wrench: tuple[float, ...], until: float) -> None:
    rows = np.loadtxt(DATA / f"{file}.csv", delimiter=",", skiprows=1)
    rows = rows[rows[:, 0] <= until + 1e-9]
    start = state_at(rows[0, 1:4], rows[0, 4:7], rows[0, 7:])
    got = as_csv(simulate(body, start, rows[:, 0], constant(wrench)))
    size = np.abs(rows[:, 1:]).max(axis=0)
    size = np.repeat([size[:3].max(), size[3:6].max(), size[6:9].max(), size[9:].max()], 3)
    assert np.all(np.abs(got - rows[:, 1:]) <= 2e-6 * size + 1e-12)


@pytest.mark.slow
def test_either_frame_gives_the_same_motion() -> None:
    """A roll, a current and a skew wrench in NED, and the same three turned into ENU/FLU."""
    T6 = np.kron(np.eye(2), np.diag([1.0, -1.0, -1.0]))
    times = np.linspace(0, 3, 4)
    tau, current = np.array([10.0, 5, -3, 0.2, 0.1, 0.5]), np.array([0.3, -0.2, 0.1])
    ned = simulate(WU2018, state_at((1, 2, 3), (0.3, -0.2, 0.5)), times, constant(tau), current)
    enu = simulate(
        WU2018.flipped(),
        state_at((1, -2, -3), (0.3, 0.2, -0.5)),
        times,
        constant(T6 @ tau),
        T6[:3, :3] @ current,
    )
    assert WU2018.down == NED
    assert WU2018.flipped().down == ENU
    np.testing.assert_allclose(enu[:, :3], ned[:, :3] * [1, -1, -1], atol=1e-10)
    np.testing.assert_allclose(enu[:, 7:], ned[:, 7:] @ T6, atol=1e-10)


@pytest.mark.parametrize("body", [BLUEROV2, WU2018, VON_BENZON, REXROV, LRAUV], ids=lambda b: b.name)
def test_mass_matrices(body: Body) -> None:
    np.testing.assert_allclose(body.M(), body.M().T, atol=1e-12 * np.abs(body.M()).max())
    assert np.linalg.eigvalsh(body.M()).min() > 0


@pytest.mark.parametrize("body", [BLUEROV2, WU2018, REXROV], ids=lambda b: b.name)
def test_two_forms_of_the_rigid_body_coriolis_matrix_do_the_same(body: Body) -> None:
    nu = np.array([1.2, -0.4, 0.3, 0.2, -0.5, 0.7])
    np.testing.assert_allclose(body.C_RB(nu) @ nu, coriolis_of(body.M_RB(), nu) @ nu, atol=1e-9)


@pytest.mark.slow
def test_relative_motion_is_galilean() -> None:
    """A vehicle that turns in a moving water body moves as it would in still water, carried along."""
    times, current = np.linspace(0, 5, 6), np.array([0.4, -0.3, 0.2])
    start = state_at((0, 0, 5), (0.1, 0.2, 0.3), (0.5, 0.1, 0, 0.1, 0.2, 0.6))
    still = simulate(VON_BENZON, start, times, constant((5, 1, 0, 0, 0.1, 0.4)))
    carried = start.copy()
    carried[7:10] += rotation(start[3:7]).T @ current
    moving = simulate(VON_BENZON, carried, times, constant((5, 1, 0, 0, 0.1, 0.4)), current)
    np.testing.assert_allclose(moving[:, :3], still[:, :3] + times[:, None] * current, atol=1e-9)
    np.testing.assert_allclose(moving[:, 3:7], still[:, 3:7], atol=1e-9)


def test_rk4_is_of_fourth_order() -> None:
    """Without quadratic damping (whose second derivative jumps at rest) halving the step wins a factor of 16."""
    from dataclasses import replace

    body = replace(BLUEROV2, D_q=np.zeros(6))
    times, start = (
        np.array([0.0, 2.0]),
        state_at((0, 0, -5), (0.2, 0.1, 0.4), (0.5, -0.2, 0.1, 0.1, 0.3, -0.4)),
    )
    exact = simulate(body, start, times, constant((10, 2, 1, 0.1, 0.2, 0.5)))[-1]
    errors = [
        np.abs(simulate(body, start, times, constant((10, 2, 1, 0.1, 0.2, 0.5)), step=h)[-1] - exact).max()
        for h in (0.1, 0.05)
    ]
    assert 14 < errors[0] / errors[1] < 18


class TestTethys:
    """Section 'plain Fossen integration' of the LRAUV system tests."""

    @staticmethod
    def run(start: Array, times: Array, **inputs: float) -> Array:
        return simulate(LRAUV, start, times, lambda t, y: actuators.tethys(nu=y[7:], q=y[3:7], **inputs))

    def test_forward(self) -> None:
        times = np.array([0.0, 36, 40, 45])
        rows = as_csv(self.run(state_at((0, 0, -0.5)), times, omega=10 * np.pi))
        np.testing.assert_allclose(rows[1:, 6], [0.9672, 0.9930, 1.0155], atol=5e-5)
        tau = 153.243161 / np.sqrt(6.980 * 6.2282)
        u_inf = np.sqrt(6.980 / 6.2282)
        np.testing.assert_allclose(rows[:, 6], u_inf * np.tanh(times / tau), rtol=1e-6)
        assert rows[2, 0] == pytest.approx(26.07, abs=5e-3)

    def test_turn(self) -> None:
        straight = self.run(state_at((0, 0, -0.5)), np.array([0.0, 50]), omega=10 * np.pi)[-1]
        row = as_csv(self.run(straight, np.linspace(50, 58, 9), omega=10 * np.pi, rudder=-0.5))[-1]
        np.testing.assert_allclose(row[[5, 6, 7, 11]], [0.774, 0.856, -0.187, 0.1055], atol=5e-4)

    def test_turn_at_the_joint_limit(self) -> None:
        straight = self.run(state_at((0, 0, -0.5)), np.array([0.0, 50]), omega=10 * np.pi)[-1]
        row = as_csv(self.run(straight, np.linspace(50, 58, 9), omega=10 * np.pi, rudder=-0.261799))[-1]
        assert row[11] == pytest.approx(0.064, abs=5e-4)

    def test_sink(self) -> None:
        """The engine moves at 3e-6 m3/s, so that it is still on its way to .0002 m3 after 40 s."""
        states = simulate(
            LRAUV,
            state_at((0, 0, -0.5)),
            np.linspace(0, 40, 41),
            lambda t, y: actuators.tethys(nu=y[7:], q=y[3:7], engine=-3e-6 * t),
        )
        assert -states[-1, 9] == pytest.approx(0.0407, abs=5e-5)
        assert -states[-1, 2] == pytest.approx(1.252, abs=5e-4)


def test_von_benzon_thruster() -> None:
    V = np.linspace(0.1, 1.0, 10)
    expected = [1.062, 3.064, 6.523, 11.288, 16.594, 21.434, 25.129, 27.754, 29.83, 30.4]
    np.testing.assert_allclose(actuators.von_benzon_curve(V), expected, atol=5e-4)
    times = np.linspace(0, 2, 201)
    assert actuators.von_benzon_lag(np.full(201, 10.0), times)[-1] == pytest.approx(10.0, rel=1e-6)


def test_quaternion_of_angles() -> None:
    R = rotation(quaternion(0.3, 0.2, 0.1))
    assert R[2, 0] == pytest.approx(-np.sin(0.2))
    assert np.arctan2(R[1, 0], R[0, 0]) == pytest.approx(0.1)


class TurnedSign(Body):
    """The added-mass Coriolis term as gz-sim's Hydrodynamics plugin applies it."""

    def C_A(self, nu_r: Array) -> Array:
        return -coriolis_of(self.M_A, nu_r)


@pytest.mark.parametrize(("kind", "pitch", "climb"), [(Body, -0.095, 0.212), (TurnedSign, -0.235, 0.294)])
def test_gazebo_by_either_sign_of_the_coriolis_term(kind: type[Body], pitch: float, climb: float) -> None:
    """4 x 10 N ahead as measured on gz-sim 8.14.0 with `fluid_added_mass` and with the Hydrodynamics plugin.

    That the second follows from one turned sign settles who is right about the first.
    """
    body = kind(**{field.name: getattr(BLUEROV2, field.name) for field in fields(BLUEROV2)})
    tau = allocation("bluerov2") @ np.array([10.0, 10, 10, 10, 0, 0])
    rows = as_csv(simulate(body, state_at(), np.array([0.0, 10, 15]), constant(tau)))
    assert rows[-1, 4] == pytest.approx(pitch, abs=1e-3)
    assert (rows[-1, 2] - rows[-2, 2]) / 5 == pytest.approx(climb, abs=7e-4)

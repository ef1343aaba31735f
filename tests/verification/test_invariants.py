"""What must hold for any vehicle, state and input, searched for counterexamples by hypothesis."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from auvbench.dynamics import frames
from auvbench.dynamics.rigid_body import coriolis
from auvbench.simulators import openloop
from auvbench.simulators.fossen import FossenSimulator
from auvbench.vehicles import inspect
from auvbench.vehicles.vehicle_model import VehicleModel

from ..reference.fossen import Array, Body
from ..reference.vehicles import ALL
from . import rig

NAMES = sorted(ALL)
search = settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow], derandomize=True
)


def numbers(size: int, low: float, high: float) -> st.SearchStrategy[Array]:
    return st.lists(st.floats(low, high), min_size=size, max_size=size).map(np.array)


velocities = st.tuples(numbers(3, -1.5, 1.5), numbers(3, -1.0, 1.0)).map(np.concatenate)
attitudes = (
    numbers(4, -1.0, 1.0).filter(lambda q: np.linalg.norm(q) > 0.1).map(lambda q: q / np.linalg.norm(q))
)
positions = numbers(3, -10.0, 10.0)
vehicles = st.sampled_from(NAMES)


@cache
def bare(name: str) -> VehicleModel:
    return openloop.without_actuators(rig.vehicle(name))


def fly(of: VehicleModel, pose: Array, velocity: Array, duration: float, *, wrench: object = (0,) * 6,
        current: object = (0, 0, 0), max_step: float = 0.005) -> tuple[Array, Array]:  # fmt: skip
    simulator = FossenSimulator(of, 1, max_step=max_step)
    simulator.reset(np.array([0]), pose[None], velocity[None])
    simulator.external_wrench[0] = wrench
    simulator.set_current(np.asarray(current, float))
    simulator.step(np.zeros((1, len(of.units))), duration)
    return simulator.pose[0].copy(), simulator.velocity[0].copy()


def at(position: Array, attitude: Array) -> Array:
    return np.concatenate([position, attitude])


@search
@given(vehicles, velocities)
def test_coriolis_matrices_are_skew_symmetric_and_take_no_power(name: str, nu: Array) -> None:
    of = rig.vehicle(name)
    for M in (of.M_RB, of.M_A, of.M):
        C = coriolis(M, nu)
        assert np.array_equal(C, -C.T)
        assert abs(nu @ C @ nu) <= 1e-12 * np.abs(M).max() * max(1.0, float(np.abs(nu).max()) ** 3)


def body_of(name: str) -> Body:
    body = ALL[name]
    return body if body.down < 0 else body.flipped()


@search
@given(vehicles, attitudes, velocities)
def test_energy_never_grows_without_input_in_still_water(name: str, attitude: Array, nu: Array) -> None:
    """Kinetic energy of body and added mass, plus potential energy of weight and buoyancy.

    Without C_A the added mass exchanges energy with nobody, so that vehicles which switch it off (the LRAUV) are
    tested with it on.
    """
    of = replace(bare(name), added_mass_coriolis=True)
    body = body_of(name)
    simulator = FossenSimulator(of, 1, max_step=0.002)
    simulator.reset(np.array([0]), at(np.zeros(3), attitude)[None], nu[None])
    before = body.energy(np.concatenate([simulator.pose[0], simulator.velocity[0]]))
    scale = body.m * 10.0
    for _ in range(40):
        simulator.step(np.zeros((1, 0)), 0.05)
        after = body.energy(np.concatenate([simulator.pose[0], simulator.velocity[0]]))
        assert after <= before + 1e-7 * scale
        before = after


@search
@given(vehicles, attitudes, velocities)
def test_energy_is_conserved_without_damping(name: str, attitude: Array, nu: Array) -> None:
    of = replace(
        bare(name), added_mass_coriolis=True, linear_damping=np.zeros(6), quadratic_damping=np.zeros(6)
    )
    body = body_of(name)
    before = body.energy(np.concatenate([np.zeros(3), attitude, nu]))
    pose, velocity = fly(of, at(np.zeros(3), attitude), nu, 2.0, max_step=0.001)
    after = body.energy(np.concatenate([pose, velocity]))
    assert after == pytest.approx(before, rel=1e-6, abs=1e-6 * body.m)


@search
@given(vehicles, positions, attitudes, velocities)
def test_quaternion_stays_of_length_one(name: str, position: Array, attitude: Array, nu: Array) -> None:
    pose, _ = fly(bare(name), at(position, attitude), nu, 3.0, max_step=0.005)
    assert np.linalg.norm(pose[3:]) == pytest.approx(1.0, abs=1e-12)


@search
@given(positions, attitudes, velocities)
def test_frames_round_trip(position: Array, attitude: Array, nu: Array) -> None:
    pose = at(position, attitude)
    assert np.array_equal(frames.flip_pose(frames.flip_pose(pose)), pose)
    assert np.array_equal(frames.flip(frames.flip(nu)), nu)
    R = frames.rotation(attitude)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)
    np.testing.assert_allclose(frames.rotation(frames.quaternion(frames.euler(attitude))), R, atol=1e-7)


@search
@given(vehicles, positions, attitudes, velocities, numbers(6, -1.0, 1.0), numbers(3, -0.5, 0.5))
def test_ned_and_enu_tell_the_same_motion(
    name: str, position: Array, attitude: Array, nu: Array, push: Array, current: Array
) -> None:
    """The same physical run, typed in NED/FRD and in ENU/FLU, ends at the same place."""
    of, pose = bare(name), at(position, attitude)
    wrench = push * of.mass * [1, 1, 1, 0.05, 0.05, 0.05]
    inputs = {"wrench": wrench, "pose": pose, "velocity": nu, "current": current}
    turned = {
        "wrench": frames.flip(wrench), "pose": frames.flip_pose(pose), "velocity": frames.flip(nu), "current": frames.flip(current),
    }  # fmt: skip
    enu = openloop.integrate(of, duration=1.0, sample=0.5, frame="enu", max_step=0.01, **inputs)
    ned = openloop.integrate(of, duration=1.0, sample=0.5, frame="ned", max_step=0.01, **turned)
    assert np.array_equal(frames.flip_pose(ned.pose), enu.pose)
    assert np.array_equal(frames.flip(ned.velocity), enu.velocity)


@search
@given(vehicles, positions, attitudes)
def test_neutral_and_balanced_stays_put(name: str, position: Array, attitude: Array) -> None:
    of = bare(name)
    neutral = replace(of, buoyancy=of.weight, center_of_buoyancy=of.center_of_gravity)
    pose, velocity = fly(neutral, at(position, attitude), np.zeros(6), 20.0, max_step=0.02)
    np.testing.assert_allclose(pose, at(position, attitude), atol=1e-12)
    assert np.all(np.abs(velocity) < 1e-12)


MIRROR_NU = np.array([1.0, -1, 1, -1, 1, -1])
MIRROR_POSE = np.array([1.0, -1, 1, 1, -1, 1, -1])
"""Reflection in the x-z plane: polar vectors change their y, axial vectors their x and z."""

SYMMETRIC = ["bluerov2_wu2018", "bluerov2_heavy", "bluerov2_heavy_wu2018", "lrauv"]
"""The other sheets have products of inertia or off-diagonal added mass that tell port from starboard."""


@search
@given(
    st.sampled_from(SYMMETRIC), positions, attitudes, velocities, numbers(6, -1.0, 1.0), numbers(3, -0.5, 0.5)
)
def test_left_right_mirror_symmetry(
    name: str, position: Array, attitude: Array, nu: Array, push: Array, current: Array
) -> None:
    of, pose = bare(name), at(position, attitude)
    wrench = push * of.mass * [1, 1, 1, 0.02, 0.02, 0.02]
    one = fly(of, pose, nu, 1.0, wrench=wrench, current=current)
    other = fly(
        of, pose * MIRROR_POSE, nu * MIRROR_NU, 1.0, wrench=wrench * MIRROR_NU, current=current * [1, -1, 1]
    )
    np.testing.assert_allclose(other[0], one[0] * MIRROR_POSE, atol=1e-9)
    np.testing.assert_allclose(other[1], one[1] * MIRROR_NU, atol=1e-9)


@search
@given(
    st.sampled_from(["surge", "sway", "heave"]),
    st.floats(5.0, 200.0),
    st.floats(0.0, 50.0),
    st.floats(0.5, 200.0),
)
def test_terminal_speed_meets_the_closed_form(
    axis: str, force: float, linear: float, quadratic: float
) -> None:
    k = ("surge", "sway", "heave").index(axis)
    of = rig.model(
        rig.body(10.0, D_l=np.full(6, linear), D_q=np.full(6, quadratic), M_A=np.diag([5.0] * 3 + [0.1] * 3))
    )
    _, velocity = fly(of, at(np.zeros(3), np.array([1.0, 0, 0, 0])), np.zeros(6), 100.0,
                      wrench=np.eye(6)[k] * force, max_step=0.02)  # fmt: skip
    assert velocity[k] == pytest.approx(inspect.terminal_speed(force, linear, quadratic), rel=1e-6)


@search
@given(st.floats(5.0, 200.0), st.floats(0.0, 50.0), st.floats(0.5, 200.0))
def test_time_to_63_percent_meets_the_closed_form(force: float, linear: float, quadratic: float) -> None:
    of = rig.model(
        rig.body(10.0, D_l=np.full(6, linear), D_q=np.full(6, quadratic), M_A=np.diag([5.0] * 3 + [0.1] * 3))
    )
    time = inspect.rise_time(15.0, force, linear, quadratic)
    _, velocity = fly(of, at(np.zeros(3), np.array([1.0, 0, 0, 0])), np.zeros(6), time,
                      wrench=np.eye(6)[0] * force, max_step=time / 500)  # fmt: skip
    assert velocity[0] == pytest.approx(
        (1 - np.exp(-1)) * inspect.terminal_speed(force, linear, quadratic), rel=1e-6
    )


@search
@given(vehicles, attitudes, numbers(3, -1.0, 1.0), velocities)
def test_drifting_with_a_constant_current_feels_nothing(
    name: str, attitude: Array, current: Array, nu: Array
) -> None:
    """In moving water the vehicle does what it does in still water, carried along, while it turns and slides."""
    of = replace(bare(name), added_mass_coriolis=True)  # without C_A the LRAUV's model is not Galilean
    R = frames.rotation(attitude)
    carried = nu.copy()
    carried[:3] += R.T @ current
    still = fly(of, at(np.zeros(3), attitude), nu, 2.0, max_step=0.002)
    moving = fly(of, at(np.zeros(3), attitude), carried, 2.0, current=current, max_step=0.002)
    np.testing.assert_allclose(moving[0][:3], still[0][:3] + 2.0 * current, atol=1e-8)
    np.testing.assert_allclose(moving[0][3:], still[0][3:], atol=1e-8)


@search
@given(vehicles, attitudes, numbers(3, -1.5, 1.5))
def test_current_equal_to_the_velocity_means_no_drag(name: str, attitude: Array, v: Array) -> None:
    of = bare(name)
    neutral = replace(of, buoyancy=of.weight, center_of_buoyancy=of.center_of_gravity)
    nu = np.concatenate([frames.rotation(attitude).T @ v, np.zeros(3)])
    acceleration = rig.acceleration(neutral, nu, pose=at(np.zeros(3), attitude), current=v)
    assert np.abs(acceleration).max() < 1e-9


@pytest.mark.parametrize("name", NAMES)
def test_halving_the_step_shrinks_the_error_as_its_order_says(name: str) -> None:
    """60 s of a gentle manoeuvre in a current: the change from h to h/2 shrinks 16-fold with h, or is rounding.

    The motion turns and slides without passing through rest, where |nu| nu has no second derivative and any
    method of fourth order loses some of it.
    """
    of = bare(name)
    level = replace(of, buoyancy=of.weight)
    wrench = np.array([0.4, 0.15, 0.05, 0.0, 0.0, 0.01]) * of.mass
    pose, nu = (
        at(np.zeros(3), frames.quaternion([0.05, 0.04, 0.3])),
        np.array([0.3, 0.1, 0.05, 0.02, 0.02, 0.05]),
    )

    def end(h: float) -> Array:
        return np.concatenate(
            fly(level, pose, nu, 60.0, wrench=wrench, current=(0.1, -0.05, 0.02), max_step=h)
        )

    coarse, middle, fine = end(0.02), end(0.01), end(0.005)
    first, second = np.abs(coarse - middle).max(), np.abs(middle - fine).max()
    assert second < 1e-6
    assert second <= first / 8 or second < 1e-10

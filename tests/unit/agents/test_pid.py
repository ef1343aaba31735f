"""How the classical baseline allocates thrust, on vehicles other than the one it was tuned on."""

from __future__ import annotations

import numpy as np
import pytest

from auvbench.agents.classical.cascade import CRUISE_SHARE
from auvbench.agents.classical.pid import PIDController
from auvbench.vehicles.sheet import load
from tests import configs

WRENCHES = np.diag([1.0, 1.0, 1.0, 0.0, 0.0, 1.0])[[0, 1, 2, 5]]


def controller(name: str) -> PIDController:
    return PIDController(configs.training("algo=pid", f"vehicle={name}"), load(name))


@pytest.mark.parametrize("name", ["bluerov2_heavy", "bluerov2_heavy_wu2018", "rexrov"])
def test_no_tipping_moment_where_the_thrusters_can_avoid_it(name):
    pid = controller(name)
    np.testing.assert_allclose(pid._allocate(WRENCHES) @ pid.vehicle.allocation.T, WRENCHES, atol=1e-9)


def test_what_cannot_be_avoided_does_not_spoil_the_rest():
    """bluerov2 pitches when it surges; force, roll and yaw are as wanted all the same."""
    pid = controller("bluerov2")
    rows = [0, 1, 2, 3, 5]
    got = pid._allocate(WRENCHES) @ pid.vehicle.allocation.T
    np.testing.assert_allclose(got[:, rows], WRENCHES[:, rows], atol=1e-9)


@pytest.mark.parametrize("name", ["bluerov2", "bluerov2_wu2018", "bluerov2_heavy"])
def test_the_wanted_velocity_can_be_held_upright(name):
    pid = controller(name)
    rng = np.random.default_rng(0)
    wanted = pid._feasible(3.0 * rng.normal(size=(50, 3)))
    wrench = np.zeros((50, 6))
    wrench[:, :3] = pid._drag(wanted)
    thrust = pid._allocate(wrench)
    assert (np.abs(thrust) / pid.reach[1]).max() <= CRUISE_SHARE + 0.1
    tilt = np.abs(thrust @ pid.tilting.T).max()
    assert tilt <= 1.1 * pid.tilt_limit


def test_integral_action_turns_against_a_steady_yaw_error_and_not_during_a_turn():
    words = ("algo=pid", "vehicle=bluerov2_heavy", "task=station_keeping")
    still, moving = np.zeros((2, 3)), np.array([True, True])
    moments = {}
    for time in ("null", "10"):
        pid = PIDController(
            configs.training(*words, f"algo.heading_integral_time={time}"), load("bluerov2_heavy")
        )
        pid.reset(np.arange(2))
        pid.estimate.yaw_error = np.array([0.1, 1.0])
        for _ in range(50):  # 5 s
            pid.after(still, moving)
        moments[time] = pid.law(still, still)[:, 5]
    # 0.1 rad for 5 s of 10 s adds half of the proportional part; 1 rad is a turn.
    np.testing.assert_allclose(moments["10"] / moments["null"], [1.5, 1.0])


def test_no_integral_of_the_heading_grows_while_a_thruster_saturates():
    pid = PIDController(
        configs.training(
            "algo=pid", "algo.heading_integral_time=10", "vehicle=bluerov2_heavy", "task=station_keeping"
        ),
        load("bluerov2_heavy"),
    )
    pid.reset(np.arange(1))
    pid.estimate.yaw_error = np.array([0.1])
    pid.after(np.zeros((1, 3)), np.array([False]))
    assert pid.heading_integral == 0.0

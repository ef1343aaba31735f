"""The classical baseline on vehicles other than the one it was tuned on."""

import numpy as np
import pytest

from auvbench.agents.pid import PIDController
from auvbench.config.compose import compose, typed
from auvbench.vehicles.inspect import reach
from auvbench.vehicles.sheet import load


def controller(name):
    return PIDController(typed(compose("train", ["algo=pid", f"vehicle={name}"])), load(name))


@pytest.mark.parametrize("name", ["bluerov2_heavy", "bluerov2_heavy_wu2018", "rexrov"])
def test_no_tipping_moment_where_the_thrusters_can_avoid_it(name):
    pid = controller(name)
    wrench = np.diag([1.0, 1.0, 1.0, 0.0, 0.0, 1.0])
    np.testing.assert_allclose(pid.vehicle.allocation @ pid.allocation @ wrench, wrench, atol=1e-9)


def test_what_cannot_be_avoided_does_not_spoil_the_rest():
    """bluerov2 pitches when it surges; force, roll and yaw are as wanted all the same."""
    pid = controller("bluerov2")
    rows = [0, 1, 2, 3, 5]
    wrench = np.diag([1.0, 1.0, 1.0, 0.0, 0.0, 1.0])
    np.testing.assert_allclose(
        (pid.vehicle.allocation @ pid.allocation @ wrench)[rows], wrench[rows], atol=1e-9
    )


@pytest.mark.parametrize("name", ["bluerov2", "bluerov2_heavy", "lrauv"])
def test_cruise_speed_is_within_reach(name):
    pid = controller(name)
    top = next(row.speed for row in reach(pid.vehicle) if row.axis == 0)
    assert pid.cruise_speed == min(pid.gains.cruise_speed, 0.9 * top)

"""Steering by fins and ballast: the signs, and a waypoint reached with true readings."""

import numpy as np
import pytest

from auvbench.agents.steering import Steering
from auvbench.dynamics import frames
from auvbench.simulators.fossen import FossenSimulator
from auvbench.vehicles.sheet import load


@pytest.fixture(scope="module")
def lrauv():
    return load("lrauv")


def test_signs(lrauv):
    steering = Steering(lrauv, 0.6, 0.1)
    steering.reset(4)
    # Waypoints far to port, to starboard, below, above; heading east at 1 m/s.
    error = np.array([[0.0, 60, 0], [0, -60, 0], [60, 0, -30], [60, 0, 30]])
    yaw_error = np.arctan2(error[:, 1], error[:, 0])
    action = steering.act(error, yaw_error, np.tile([1.0, 0.0, 0.0], (4, 1)))
    names = dict(zip(lrauv.actuators, action.T, strict=True))
    assert np.all(names["propeller"] == 0.0)
    assert np.all(names["drop_weight"] == 0.0)
    assert np.sign(names["rudder"]).tolist() == [-1, 1, 0, 0]
    assert np.sign(names["elevator"][2:]).tolist() == [-1, 1]
    assert np.sign(names["mass_shifter"][2:]).tolist() == [1, -1]
    assert np.sign(names["buoyancy_engine"][2:]).tolist() == [-1, 1]


@pytest.mark.parametrize("waypoint", [(30.0, 10.0, -25.0), (40.0, -30.0, -14.0), (-10.0, 14.0, -35.0)])
def test_a_waypoint_is_reached(lrauv, waypoint):
    simulator = FossenSimulator(lrauv, 1, max_step=0.05)
    simulator.pose[0, 2] = -20.0
    steering = Steering(lrauv, 0.6, 0.1)
    steering.reset(1)
    nearest = np.inf
    for _ in range(1500):
        R = frames.rotation(simulator.pose[0, 3:])
        error = np.array(waypoint) - simulator.pose[0, :3]
        heading = np.arctan2(error[1], error[0]) - np.arctan2(R[1, 0], R[0, 0])
        wrapped = np.mod(heading + np.pi, 2.0 * np.pi) - np.pi
        action = steering.act(error[None], np.array([wrapped]), (R @ simulator.velocity[0, :3])[None])
        action[:, 0] = 1.0
        simulator.step(action, 0.1)
        nearest = min(nearest, float(np.linalg.norm(error)))
        if nearest < 3.0:
            break
    assert nearest < 3.0

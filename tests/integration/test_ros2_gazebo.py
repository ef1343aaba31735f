"""Gazebo in the process of `auvbench serve`: over real DDS the same bits as in this one."""

import numpy as np
import pytest

from auvbench.integrations.gazebo import bindings
from auvbench.integrations.gazebo.simulator import GazeboSimulator
from auvbench.integrations.ros2 import simulator as ros2
from auvbench.integrations.ros2.spec import Ros2
from auvbench.vehicles.sheet import load
from tests import dds
from tests.waiting import LIMIT

absent = bindings.missing()
pytestmark = [
    pytest.mark.gazebo,
    pytest.mark.slow,
    pytest.mark.skipif(absent is not None, reason=f"Gazebo is not here: {absent}"),
    dds.needs_ros,
    pytest.mark.slow,
]


def test_a_served_gazebo_is_the_same_bits():
    vehicle = load("bluerov2")
    rng = np.random.default_rng(0)
    pose = np.array([[0.0, 0.0, -5.0, 1.0, 0.0, 0.0, 0.0]])
    with dds.domain(), dds.serving("--lockstep", "simulator=gazebo"):
        there = ros2.Ros2Simulator(vehicle, 1, Ros2(name="ros2", namespace=None, clock="auto", timeout=LIMIT))
        here = GazeboSimulator(vehicle, 1, max_step=0.01)
        for _ in range(2):  # the second time a reset must have reset everything
            for simulator in (here, there):
                simulator.reset(np.arange(1), pose, np.zeros((1, 6)))
            for _ in range(15):
                action = rng.uniform(-1.0, 1.0, (1, 6))
                for simulator in (here, there):
                    simulator.step(action, 0.1)
                np.testing.assert_array_equal(here.pose, there.pose)
                np.testing.assert_array_equal(here.velocity, there.velocity)
        assert "simulator gazebo" in ros2.used()["ros2"]
        ros2.leave()

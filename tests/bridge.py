"""A pilot in this process, over real MAVLink bytes, and the vehicle that it steers."""

from __future__ import annotations

import time

import numpy as np

from auvbench.integrations.mavlink.pilot import Pilot
from auvbench.pilot.steering import Limits, Steering
from auvbench.tasks.observation_spec import observation_spec
from auvbench.vehicles.sheet import load
from tests import configs
from tests.mavlink_vehicle import ArduSub
from tests.waiting import LIMIT

SPEC = observation_spec(configs.training("algo=pid").task, load("bluerov2").actuators)
NEUTRAL = (0, 0, 500, 0, 0, 0)


class Ahead:
    """Quarter thrust ahead, whatever is seen; or what a test wants instead."""

    answer = np.array([[0.25, 0.25, 0.25, 0.25, 0.0, 0.0]])
    error = None

    def reset(self, episodes):
        pass

    def act(self, observation):
        assert np.all(np.isfinite(observation))
        if self.error is not None:
            raise self.error
        return self.answer


class Clock:
    """Time of a pilot in this process: it goes on by steps, however busy the machine is."""

    def __init__(self):
        self.now = 0.0

    def monotonic(self):
        return self.now


class Bridge:
    """A vehicle and the pilot in this process that steers it."""

    def __init__(self, clock, port, *, limits=None):
        self.clock, self.said, self.controller = clock, [], Ahead()
        self.limits = limits or Limits(
            depth_low=-60.0,
            depth_high=-1.0,
            goal_radius=1.0,
            max_steps=10_000,
            pose_timeout=0.5,
            lost_after=5.0,
            patience=LIMIT,
        )
        self.vehicle = ArduSub(port)
        self.port = port
        self.pilot = None

    def open(self, address=None):
        steering = Steering(self.controller, load("bluerov2"), 10.0, SPEC, self.limits)
        self.pilot = Pilot(address or f"udp:127.0.0.1:{self.port}", steering, say=self.said.append)
        assert self.pilot.steer_to([1e4, 0.0, -20.0])
        return self.pilot

    def until(self, condition, step=0.001):
        """Let the pilot's time go on by `step` at a time: by default it stands still nearly, so that no pose gets old."""
        end = time.monotonic() + LIMIT
        while not condition():
            assert time.monotonic() < end, (self.said, self.vehicle.sticks[-3:])
            self.clock.now += step
            self.pilot.spin_once()

    def fly(self):
        """Arm, and wait until the vehicle is steered."""
        assert self.pilot.arm() == ""
        self.until(lambda: self.vehicle.sticks[-1][0] > 100, step=0.05)

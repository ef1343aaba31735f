"""What a controller knows from the noisy observation: position error, yaw, and filtered rates of both."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.observation import BODY, ObservationSpec

Floats = NDArray[np.float64]


class Estimator:
    """Readings and velocities of N vehicles.

    Yaw is the bearing of the waypoint less the yaw error; velocities are differences of readings through a
    first-order low-pass filter, discretised exactly.

    Args:
        dt: s between readings.
        filter_time: s, time constant of the filter.
        spec: of the observation.

    Raises:
        ConfigError: the task observes no yaw error or no position error.
    """

    def __init__(self, dt: float, filter_time: float, spec: ObservationSpec) -> None:
        self.dt = dt
        self._yaw_error, self._error = spec["yaw_error"], spec["position_error"]
        self.body_frame = spec.blocks["position_error"].axes == BODY
        self._smoothing = 1.0 - np.exp(-dt / filter_time)
        self.reset(0)

    def reset(self, n: int) -> None:
        self.first: NDArray[np.bool_] = np.ones(n, dtype=np.bool_)
        """(n,) where no reading has come yet"""
        self.error: Floats = np.zeros((n, 3))
        """(n, 3) m to the waypoint, world axes; axes of the body at the start with `body_frame`"""
        self.yaw: Floats = np.zeros(n)
        self.yaw_error: Floats = np.zeros(n)
        self.velocity: Floats = np.zeros((n, 3))
        """(n, 3) m/s in the axes of `error`"""
        self.yaw_rate: Floats = np.zeros(n)

    def update(self, observation: Floats) -> None:
        """Takes in observations (n, n_obs)."""
        yaw_error = observation[:, self._yaw_error].ravel()
        error = observation[:, self._error].copy()
        bearing = np.arctan2(error[:, 1], error[:, 0])
        # In the body frame the bearing is the yaw error and yaw stays 0: the frame turns with the vehicle, and
        # its turning is small within the filter's time.
        yaw = np.zeros(len(error)) if self.body_frame else wrap(bearing - yaw_error)
        # One reading tells no velocity.
        a = np.where(self.first, 0.0, self._smoothing)
        # The waypoint stands still: the error shrinks by the way made.
        self.velocity += a[:, None] * ((self.error - error) / self.dt - self.velocity)
        turned = wrap(self.yaw_error - yaw_error) if self.body_frame else wrap(yaw - self.yaw)
        self.yaw_rate += a * (turned / self.dt - self.yaw_rate)
        self.error, self.yaw, self.yaw_error = error, yaw, yaw_error
        self.first = np.zeros(len(error), dtype=np.bool_)

    def memory(self) -> dict[str, NDArray[Any]]:
        """What it carries from reading to reading, by name: its own arrays, a row for each vehicle."""
        names = ("first", "error", "yaw", "yaw_error", "velocity", "yaw_rate")
        return {name: getattr(self, name) for name in names}


def wrap(angle: Floats) -> Floats:
    """Angles in [-pi, pi)."""
    return np.asarray(np.mod(angle + np.pi, 2.0 * np.pi) - np.pi)


def to_body(world: Floats, yaw: Floats) -> Floats:
    """Vectors (n, 3) from world axes to the levelled body's, turned by yaw (n,)."""
    c, s = np.cos(yaw), np.sin(yaw)
    x, y, z = world.T
    return np.stack([c * x + s * y, c * y - s * x, z], axis=1)

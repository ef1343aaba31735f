"""Readings of an episode's sensors as arrays with covariances, for programs outside auvbench."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from auvbench.tasks.navigation import usbl
from auvbench.tasks.navigation.dvl import BEAMS
from auvbench.tasks.navigation.state import DEPTH, DVL, GNSS, HEADING, NEVER, USBL

if TYPE_CHECKING:
    from auvbench.tasks.navigation.estimator import Navigation

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """A reading that has arrived."""

    age: float  # s since the measurement
    value: Floats  # (k,)
    covariance: Floats  # (k, k)


def readings(navigation: Navigation, i: int) -> dict[str, Reading]:
    """Return the last readings of environment i by sensor, except for sensors without a reading or with a reading under way.

    Each covariance includes the errors that last an episode, even if these errors are states of auvbench's filter. It does not include
    the filter's `inflation`. A velocity relative to the water is left out, so that no program mistakes it for a velocity over ground.

    Returns:
        `imu`: specific force in m/s2 and rates in rad/s; `dvl`: velocity in m/s, body axes, at the DVL; `depth`: height in m;
        `heading`: yaw in rad; `usbl`: position (3,) in m; `gnss`: horizontal position (2,) in m.
    """
    d, p = navigation.state[i], navigation.parameters[0]
    seen: dict[str, Reading] = {}
    root = [p.accelerometer_density] * 3 + [p.gyro_density] * 3
    turn_on = [p.accelerometer_turn_on] * 3 + [p.gyro_turn_on] * 3
    white, slow = np.square(root) * p.imu_rate, np.square(turn_on)
    seen["imu"] = Reading(0.0, np.concatenate([d.specific_force, d.rates]), np.diag(white + slow))
    ages = d.time - d.stamp

    def put(name: str, sensor: int, value: Any, covariance: Floats) -> None:
        if d.stamp[sensor] >= 0.0 and d.arrives[sensor] == NEVER:
            seen[name] = Reading(
                float(ages[sensor]), np.array(value, dtype=np.float64, ndmin=1), np.atleast_2d(covariance)
            )

    if p.has_dvl and not d.on_water:
        put("dvl", DVL, d.dvl_velocity, _of_velocity(d, p))
    z = float(d.height)
    depth = (
        p.depth_noise**2
        + p.depth_resolution**2 / 12.0
        + p.depth_offset**2
        + (p.depth_density * z) ** 2
        + d.wave_variance
    )
    put("depth", DEPTH, z, np.array(depth))
    put("heading", HEADING, d.heading, np.array(_of_heading(d, p)))
    if p.has_usbl:
        lines, r = usbl.sight(tuple(d.fix - p.usbl_position))
        aside = (p.usbl_angle_noise**2 + p.usbl_alignment**2) * r * r
        B = np.array(lines)
        put("usbl", USBL, d.fix, B.T @ np.diag([p.usbl_range_noise**2, aside, aside]) @ B)
    if p.has_gnss:
        put("gnss", GNSS, d.gnss_fix, (p.gnss_noise**2 + p.gnss_offset**2) * np.eye(2))
    return seen


def _of_heading(d: Any, p: Any) -> float:
    """Return the variance of the compass's yaw. It includes the constant error, even if this error is a state of the filter."""
    slow = p.heading_slow**2 + 0.5 * d.thruster_iron**2 + (p.heading_bias**2 if p.bias_state else 0.0)
    return float(p.heading_noise**2 + slow)


def _of_velocity(d: Any, p: Any) -> Floats:
    """Return the covariance (3, 3) of the DVL's velocity, from the errors of the beams, the scale and the mounting."""
    level = math.sqrt(0.5) * p.dvl_sine
    signs = np.array([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)])
    beams = np.column_stack([level * signs, np.full(BEAMS, -p.dvl_cosine)])[np.array(d.valid) > 0]
    if len(beams) < 3:  # The last ping gave no velocity, so the reading is from an earlier ping.
        beams = np.column_stack([level * signs, np.full(BEAMS, -p.dvl_cosine)])
    beam_sd = d.merit * math.sqrt(2.0) * p.dvl_sine
    slow = (p.dvl_scale**2 + p.dvl_mounting**2) * float(np.dot(d.dvl_velocity, d.dvl_velocity))
    return np.asarray(beam_sd**2 * np.linalg.inv(beams.T @ beams) + slow * np.eye(3))

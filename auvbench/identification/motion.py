"""Estimate a vehicle's state at each row of a log from the measurements."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from auvbench.dynamics import frames
from auvbench.identification.log import ATTITUDE, CHANNELS, POSITION, RATES, VELOCITY, Log

FloatArray = NDArray[np.float64]

DEPTH = -5.0
"""z in m that is assumed if a log has no depth."""
SPAN = 0.15
"""Time in s before and after a row within which positions or angles are used to derive the row's velocity.

At least one measurement before the row and one after the row are used."""
UNKNOWN = 0.3
"""Standard deviation of a velocity that was neither measured nor derived, m/s and rad/s."""


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """State of the vehicle in each row of a log, with values that were not measured interpolated, derived or assumed."""

    state: FloatArray
    """(T, 12) values of `CHANNELS`."""
    source: tuple[str, ...]
    """For each channel: "measured", "derived" from position or attitude, or "" for an assumed value."""
    spread: FloatArray
    """(12,) ratio of a derived state's standard deviation to the standard deviation of the channel from which the state is derived;
    0 for a measured state, infinite for an assumed velocity or rate."""


def of_log(log: Log) -> Motion:
    """Return the vehicle's state in each row of a log, from the measurements."""
    state = np.zeros((log.time.size, len(CHANNELS)))
    state[:, 2] = DEPTH
    source = [""] * len(CHANNELS)
    for index, channel in enumerate(CHANNELS):
        if log.has(channel):
            state[:, index] = _filled(log, index)
            source[index] = "measured"
    world = np.zeros((log.time.size, 6))
    for index in range(6):
        if source[index]:
            world[:, index] = _slope(log, index)
    quaternion = frames.quaternion(state[:, ATTITUDE])
    body = np.einsum("tji,tj->ti", frames.rotation(quaternion), world[:, POSITION])
    _derive(state, source, VELOCITY, body, any(source[POSITION]))
    _derive(state, source, RATES, _rates(state[:, ATTITUDE], world[:, ATTITUDE]), any(source[ATTITUDE]))
    spread = np.zeros(len(CHANNELS))
    for index in range(6, 12):
        if source[index] == "derived":
            spread[index] = _derived_spread(log, index - 6)
        elif not source[index]:
            spread[index] = np.inf
    return Motion(state, tuple(source), spread)


def _derive(state: FloatArray, source: list[str], part: slice, values: FloatArray, there: bool) -> None:
    """In place, set velocities or rates that were not measured to `values` (T, 3), if their positions or angles were measured."""
    for column, index in enumerate(range(part.start, part.stop)):
        # A body component is derived only if the same world axis was measured; at small tilt the two axes coincide.
        if not source[index] and there and source[index - 6]:
            state[:, index] = values[:, column]
            source[index] = "derived"


def _rates(angles: FloatArray, change: FloatArray) -> FloatArray:
    """Return body rates (T, 3) from the derivatives (T, 3) of roll, pitch and yaw (Fossen 2011, eq. 2.28)."""
    roll, pitch, _ = angles.T
    d_roll, d_pitch, d_yaw = change.T
    return np.column_stack(
        [
            d_roll - np.sin(pitch) * d_yaw,
            np.cos(roll) * d_pitch + np.sin(roll) * np.cos(pitch) * d_yaw,
            -np.sin(roll) * d_pitch + np.cos(roll) * np.cos(pitch) * d_yaw,
        ]
    )


def _filled(log: Log, index: int) -> FloatArray:
    """Return a channel (T,) with missing values filled by linear interpolation."""
    column = log.measured[:, index]
    there = np.isfinite(column)
    return np.interp(log.time, log.time[there], column[there])


def interpolated(log: Log) -> FloatArray:
    """Return the measurements (T, 12) with missing values filled by linear interpolation; NaN for channels that were not measured."""
    known = np.full(log.measured.shape, np.nan)
    for index, channel in enumerate(CHANNELS):
        if log.has(channel):
            known[:, index] = _filled(log, index)
    return known


def turns(angles: FloatArray, others: FloatArray) -> FloatArray:
    """Return the rotations (..., 3) in rad from attitudes `others` to attitudes `angles` (..., 3).

    The components are along the heading of `others`, to port of this heading, and up. At small tilt the components equal the differences of
    roll, pitch and yaw. At large tilt these differences have no meaning: if two vehicles pass the vertical on opposite sides, their rolls
    differ by half a turn.
    """
    with np.errstate(invalid="ignore"):
        w, x, y, z = np.moveaxis(frames.quaternion(angles), -1, 0)
        a, b, c, d = np.moveaxis(frames.quaternion(others), -1, 0)
        real = w * a + x * b + y * c + z * d
        vector = np.stack(
            [x * a - w * b - y * d + z * c, y * a - w * c - z * b + x * d, z * a - w * d - x * c + y * b],
            axis=-1,
        )
        vector *= np.where(real < 0.0, -1.0, 1.0)[..., None]
        sine = np.linalg.norm(vector, axis=-1)
        angle = 2.0 * np.arctan2(sine, np.abs(real))
        vector *= np.where(sine > 1e-9, angle / np.maximum(sine, 1e-9), 2.0)[..., None]
        cosine, sine = np.cos(others[..., 2]), np.sin(others[..., 2])
        east, north, up = np.moveaxis(vector, -1, 0)
        return np.stack([cosine * east + sine * north, cosine * north - sine * east, up], axis=-1)


def _half_width(log: Log, index: int) -> int:
    """Return the number of measurements on each side of a row that are used to compute the row's derivative."""
    return max(1, round(SPAN / log.interval(CHANNELS[index])))


def _slope(log: Log, index: int) -> FloatArray:
    """Return the derivative (T,) of a channel: the slope of a line through the measurements around each row."""
    column = log.measured[:, index]
    slope = np.zeros(log.time.size)
    width = _half_width(log, index)
    for first, last in log.segments:
        rows = first + np.flatnonzero(np.isfinite(column[first:last]))
        if rows.size < 2:
            continue
        time, value = log.time[rows], column[rows]
        kernel = np.ones(2 * width + 1)
        t0 = time.mean()
        sums = [
            np.convolve(part, kernel, "same")
            for part in (np.ones(rows.size), time - t0, value, (time - t0) ** 2, (time - t0) * value)
        ]
        n, s_t, s_v, s_tt, s_tv = sums
        local = (s_tv - s_t * s_v / n) / (s_tt - s_t**2 / n)
        slope[first:last] = np.interp(log.time[first:last], time, local)
    return slope


def _derived_spread(log: Log, index: int) -> float:
    """Return the ratio of a derivative's standard deviation to the standard deviation of the measured channel."""
    if not log.has(CHANNELS[index]):
        return np.inf
    width, step = _half_width(log, index), log.interval(CHANNELS[index])
    places = step * np.arange(-width, width + 1)
    return float(1.0 / np.sqrt(np.sum(places**2)))

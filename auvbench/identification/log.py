"""Store one log as arrays in auvbench's axes, and make the checks that all formats share."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from auvbench.errors import UserError
from auvbench.vehicles.vehicle_model import VehicleModel

FloatArray = NDArray[np.float64]

CHANNELS = ("x", "y", "z", "roll", "pitch", "yaw", "u", "v", "w", "p", "q", "r")
"""Measured quantities: position in m and attitude in rad in world ENU, velocity in m/s and rates in rad/s in body FLU."""
UNITS = ("m",) * 3 + ("rad",) * 3 + ("m/s",) * 3 + ("rad/s",) * 3
POSITION, ATTITUDE, VELOCITY, RATES = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)
KINDS = {
    "pwm": "pulse widths in us",
    "command": "commands in [-1, 1]",
    "force": "forces in N",
    "wrench": "wrenches in N and N m",
}
"""Kinds of inputs."""
SHORTEST = 2.0
"""Shortest usable duration of a log in s."""
FEWEST = 8
"""Smallest number of rows of a log or segment, and of measurements of the channel that is measured most often."""
SLOWEST = 2.0
"""Longest median time in s between two rows; with longer times, a log misses changes of thrust and motion."""
GAP = 10.0
"""A pause that is longer than this many median steps, and longer than a second, ends a segment."""
FASTEST = (20.0,) * 3 + (35.0,) * 3
"""Largest velocities and rates of an underwater vehicle, m/s and rad/s; 35 rad/s is the range of usual gyros (2000 deg/s)."""
GRAVITY = (8.0, 11.6)
"""Smallest and largest median of the specific force of a vehicle in water, m/s2."""


class LogError(UserError):
    """A log cannot be used; the message names the file, the value and what to record instead."""


class Motors(Protocol):
    """Assignment of a vehicle's thrusters to an autopilot's motors 1, 2, ..."""

    @property
    def order(self) -> tuple[int, ...]:
        """Return, for each motor, the index of its thruster among the vehicle's actuators, (motors,)."""

    @property
    def signs(self) -> tuple[float, ...]:
        """Return, for each motor, 1 if a longer pulse pushes along the thruster's direction in the sheet, else -1: (motors,)."""


@dataclass(frozen=True, slots=True, eq=False)
class Lasting:
    """Standard deviations of errors that outlast a window, so that the scatter of a log does not show their effect.

    The errors `offset` and `drift` differ between windows, and `early` between pieces of a window; the fit estimates these three. The
    errors `all_early` and `depth_scale` are the same in all logs of a vehicle; these two and `factor` only widen the fit's intervals.
    """

    offset: FloatArray
    """(12,) constant error of each channel; infinite for a channel that is not used."""
    drift: FloatArray
    """(12,) growth of each channel's error, per s."""
    early: float
    """Time in s by which the inputs in one piece of a window are recorded too early."""
    all_early: float
    """Time in s by which all inputs are recorded too early."""
    depth_scale: float
    """Relative error of heave velocity and of changes of height, for example by salt in the water."""
    factor: float = 1.0
    """Factor on the standard deviations of a fit, for errors that the other fields do not model."""


@dataclass(frozen=True, slots=True, eq=False)
class Log:
    """Motion of one vehicle under known inputs.

    An input is constant from its row to the next row. A channel is NaN in rows in which it was not measured.
    """

    name: str
    digest: str
    """SHA-256 of the file."""
    time: FloatArray
    """(T,) times of the rows in s, increasing."""
    kind: str
    """Kind of the inputs, one of `KINDS`."""
    actuators: tuple[str, ...]
    """Names of the columns of `inputs`; if a log only numbers its thrusters, names that contain these numbers, from 1."""
    inputs: FloatArray
    """(T, n_u) inputs of the actuators, or (T, 6) wrenches in body axes."""
    measured: FloatArray
    """(T, 12) measurements of `CHANNELS`."""
    acceleration: FloatArray | None = None
    """(T, 3) specific force in body FLU, m/s2."""
    motors: Callable[[VehicleModel], Motors] | None = None
    """Function that returns which thrusters of a vehicle an autopilot's outputs C1, C2, ... drive; None: match by name or number."""
    voltage: FloatArray | None = None
    """(T,) supply voltage of the thrusters, V; None: not measured."""
    segments: tuple[tuple[int, int], ...] = ()
    """For each part without a gap, the index of its first row and the index after its last row."""
    lasting: Lasting | None = None
    """Lasting errors of the measurements; None: the measurements have only noise."""
    remarks: tuple[str, ...] = ()
    """Facts that a user should know, such as gaps."""

    @property
    def duration(self) -> float:
        """Return the duration of all segments in s."""
        return float(sum(self.time[last - 1] - self.time[first] for first, last in self.segments))

    def has(self, channel: str) -> bool:
        """Return whether a channel was measured."""
        return bool(np.isfinite(self.measured[:, CHANNELS.index(channel)]).any())

    def interval(self, channel: str) -> float:
        """Return the median time in s between two measurements of a channel."""
        there = np.isfinite(self.measured[:, CHANNELS.index(channel)])
        return float(np.median(np.diff(self.time[there])))


def longest_step(time: FloatArray) -> float:
    """Return the time in s beyond which a pause between two rows is a gap, given the times (T,) of all rows."""
    return max(1.0, GAP * float(np.median(np.diff(time))))


def checked(log: Log) -> Log:
    """Return the log with its segments and remarks.

    Raises:
        LogError: a check fails.
    """
    _check_time(log)
    _check_inputs(log)
    _check_measurements(log)
    steps = np.diff(log.time)
    breaks = np.flatnonzero(steps > longest_step(log.time)) + 1
    edges = [0, *breaks.tolist(), log.time.size]
    segments = tuple((first, last) for first, last in itertools.pairwise(edges) if last - first >= FEWEST)
    remarks = list(log.remarks)
    if breaks.size:
        at = log.time[breaks[0] - 1]
        remarks.append(
            f"{log.name}: {breaks.size} gap{'s' if breaks.size > 1 else ''} without rows, the first of"
            f" {steps[breaks[0] - 1]:.3g} s at {at:.6g} s; no window crosses a gap"
        )
    measured = log.measured.copy()
    still = [
        k
        for k in range(len(CHANNELS))
        if log.has(CHANNELS[k]) and np.nanmin(measured[:, k]) == np.nanmax(measured[:, k])
    ]
    measured[:, still] = np.nan
    if still:
        remarks.append(
            f"{log.name}: {', '.join(CHANNELS[k] for k in still)} never change: taken as not measured"
        )
    done = replace(log, segments=segments, remarks=tuple(remarks), measured=measured)
    if done.duration < SHORTEST:
        raise LogError(
            f"{log.name}: has {done.duration:.3g} s without a gap; a log needs at least {SHORTEST:g} s, better a"
            " minute for each axis"
        )
    _check_units(done)
    return done


def _check_time(log: Log) -> None:
    if log.time.size < FEWEST:
        raise LogError(f"{log.name}: has {log.time.size} rows; a log needs at least {FEWEST}")
    bad = np.flatnonzero(~np.isfinite(log.time))
    if bad.size:
        raise LogError(f"{log.name}: row {bad[0] + 1} has no time")
    back = np.flatnonzero(np.diff(log.time) <= 0.0)
    if back.size:
        row = int(back[0]) + 1
        raise LogError(
            f"{log.name}: time goes from {log.time[row - 1]:.9g} s to {log.time[row]:.9g} s in row {row + 1}; it must"
            " increase from row to row: sort the rows and drop repeated ones"
        )
    step = float(np.median(np.diff(log.time)))
    if step > SLOWEST:
        raise LogError(
            f"{log.name}: its rows are {step:.4g} s apart at the median; a log needs a row every {SLOWEST:g} s or more often: is the"
            " time in ms or us? Then name it t_ms or t_us"
        )


STEEP = 1.2
"""Pitch in rad above which measured roll and yaw are ignored, since both jump by half a turn when the bow passes the vertical."""
LIMITS = {"pwm": (800.0, 2200.0), "command": (-1.0001, 1.0001), "force": (-1e5, 1e5), "wrench": (-1e6, 1e6)}
_INSTEAD = {
    "pwm": "give pulse widths in us, or commands in [-1, 1] as NAME_cmd",
    "command": "give commands in [-1, 1], or pulse widths in us as NAME_us",
    "force": "give forces in N",
    "wrench": "give wrenches in N and N m",
}


def _check_inputs(log: Log) -> None:
    low, high = LIMITS[log.kind]
    values = log.inputs
    wrong = np.argwhere(~((values >= low) & (values <= high)))
    if wrong.size:
        row, column = (int(k) for k in wrong[0])
        raise LogError(
            f"{log.name}: input {log.actuators[column]} is {values[row, column]:g} in row {row + 1}; {KINDS[log.kind]}"
            f" are from {low:.4g} to {high:.4g}: {_INSTEAD[log.kind]}"
        )
    if np.all(values == (1500.0 if log.kind == "pwm" else 0.0)):
        raise LogError(
            f"{log.name}: all inputs are neutral; record a log in which the thrusters act, such as a telegraph signal for"
            " each axis"
        )


def _check_measurements(log: Log) -> None:
    present = np.isfinite(log.measured).sum(axis=0)
    if not np.any(present >= FEWEST):
        raise LogError(
            f"{log.name}: has no measurement; it needs at least one of position, depth, attitude, velocity or rates"
        )
    for index in (*range(6, 12),):
        fastest = FASTEST[index - 6]
        column = np.abs(log.measured[:, index])
        wrong = np.flatnonzero(column > fastest)
        if wrong.size:
            unit = UNITS[index]
            degrees = "; a column in deg/s has the ending _degps" if index >= 9 else ""
            raise LogError(
                f"{log.name}: {CHANNELS[index]} is {log.measured[wrong[0], index]:g} {unit} in row {wrong[0] + 1}; the"
                f" largest value of a vehicle in water is {fastest:g} {unit}{degrees}"
            )
    _check_jumps(log)


def _check_jumps(log: Log) -> None:
    """Raise LogError if position or attitude changes between two measurements by more than any vehicle can move."""
    for index in range(6):
        rows = np.flatnonzero(np.isfinite(log.measured[:, index]))
        steps = np.diff(log.measured[rows, index])
        seconds = np.diff(log.time[rows])
        # 0.5 allows for a sensor of coarse resolution, whose value may change by one step in a short interval.
        far = np.flatnonzero((np.abs(steps) > 0.5 + FASTEST[index] * seconds) & ~_steep(log, index, rows))
        if far.size:
            row = int(rows[far[0] + 1])
            raise LogError(
                f"{log.name}: {CHANNELS[index]} jumps by {steps[far[0]]:.4g} {UNITS[index]} in {seconds[far[0]]:.3g} s"
                f" before row {row + 1}; split the log before this row, or remove the wrong values"
            )


def _steep(log: Log, index: int, rows: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return, for each two successive `rows`, whether channel `index` is roll or yaw and the bow is near the vertical, (rows - 1,)."""
    pitch = np.abs(np.nan_to_num(log.measured[rows, 4]))
    return np.asarray((np.maximum(pitch[1:], pitch[:-1]) > STEEP) & (index in (3, 5)))


def _check_units(log: Log) -> None:
    """Raise LogError if attitude, rates, heave velocity or specific force have another unit or sign than the name of their column says."""
    tilt = np.abs(log.measured[:, 4])
    if np.nanmax(tilt, initial=0.0) > 0.5 * np.pi + 0.02:
        row = int(np.nanargmax(tilt))
        raise LogError(
            f"{log.name}: pitch is {log.measured[row, 4]:.4g} rad in row {row + 1}; it must be within +-1.571 rad: is the"
            " column in degrees? Then name it pitch_deg"
        )
    level = np.nanmax(np.abs(log.measured[:, 3:5]), initial=0.0) < 1.2  # not upside down: signs would differ
    for angle, rate in ((3, 9), (4, 10), (5, 11)):
        slope = _slope(log, angle, rate)
        if slope is not None and slope < 0.0 and level:
            raise LogError(
                f"{log.name}: {CHANNELS[rate]} has the opposite sign of the derivative of {CHANNELS[angle]}; give both in axes"
                " forward, port, up, or both forward, starboard, down with frame=ned"
            )
    for angle, rate in ((3, 9), (4, 10), (5, 11)):
        slope = _slope(log, angle, rate)
        for factor, what in (
            (57.3, "the rates look like deg/s"),
            (1 / 57.3, "the attitude looks like degrees"),
        ):
            if slope is not None and 0.6 < abs(slope) / factor < 1.6:
                raise LogError(
                    f"{log.name}: {CHANNELS[rate]} is {abs(slope):.3g} times the derivative of {CHANNELS[angle]}; {what}:"
                    " end names of columns in degrees in _deg, in deg/s in _degps"
                )
    slope = _slope(log, 2, 8)
    if slope is not None and not 0.1 < abs(slope) < 10.0:
        raise LogError(
            f"{log.name}: w is {abs(slope):.3g} times the derivative of z; give positions in m and velocities in m/s"
        )
    if log.acceleration is not None:
        norm = float(np.nanmedian(np.linalg.norm(log.acceleration, axis=1)))
        if not GRAVITY[0] <= norm <= GRAVITY[1]:
            raise LogError(
                f"{log.name}: the specific force is {norm:.4g} m/s2 at the median; a vehicle in water measures"
                " gravity, 9.8 m/s2: give ax_mps2, ay_mps2, az_mps2 with gravity"
            )


def _slope(log: Log, angle: int, rate: int) -> float | None:
    """Return the ratio of a rate to the derivative of its angle, or of w to the derivative of z; None if the log does not determine it."""
    rows = np.flatnonzero(np.isfinite(log.measured[:, angle]) & np.isfinite(log.measured[:, rate]))
    if rows.size < 5 * FEWEST:
        return None
    turn = np.diff(log.measured[rows, angle])
    values = log.measured[rows, rate]
    area = 0.5 * (values[1:] + values[:-1]) * np.diff(log.time[rows])
    # Sums over ten rows, so that an angle's noise does not hide its change.
    width = min(10, turn.size)
    kernel = np.ones(width)
    turn, area = (np.convolve(part, kernel, "valid") for part in (turn, area))
    power, product = float(np.sqrt(np.mean(turn**2) * np.mean(area**2))), float(np.mean(turn * area))
    if power == 0.0 or abs(product) < 0.8 * power:
        return None
    return float(np.copysign(np.sqrt(np.mean(area**2) / np.mean(turn**2)), product))

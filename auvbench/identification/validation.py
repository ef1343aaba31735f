"""Replay logs in windows, and compare predictions with the measurements at several horizons."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from auvbench.dynamics import frames
from auvbench.identification import motion
from auvbench.identification.log import CHANNELS, Log, LogError
from auvbench.identification.windows import Predictor, Windows, step_of, tumbles
from auvbench.vehicles.identified import Identified
from auvbench.vehicles.vehicle_model import VehicleModel

FloatArray = NDArray[np.float64]

HORIZONS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
"""Prediction horizons in s."""
STRIDE = 0.5
"""Shortest time in s between the starts of two windows."""
MOST = 600
"""Largest number of windows."""
BAND = 0.9
"""Fraction of the measurements that a prediction band should cover."""
DRAWS = 24
"""Number of vehicles drawn from an identified sheet for its bands."""
HOLD, CONSTANT = "hold", "constant velocity"
FEWEST = 5
"""Smallest number of windows for which an error is shown."""


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """Prediction errors of one sheet or baseline in all windows."""

    name: str
    error: FloatArray
    """(n, horizons, 12) prediction less measurement, NaN where nothing was measured."""
    band: FloatArray | None = None
    """(n, horizons, 12) half widths of the bands; NaN where the sheet gives no error."""

    def rms(self) -> FloatArray:
        """Return the root mean square errors (horizons, 12); NaN with fewer than `FEWEST` windows."""
        count = np.isfinite(self.error).sum(axis=0)
        mean = np.nansum(self.error**2, axis=0) / np.maximum(count, 1)
        return np.where(count >= FEWEST, np.sqrt(mean), np.nan)

    def coverage(self) -> float | None:
        """Return the fraction of measurements within the bands; None without bands."""
        if self.band is None:
            return None
        there = np.isfinite(self.error) & np.isfinite(self.band)
        return float(np.mean(np.abs(self.error)[there] <= self.band[there])) if there.any() else None


@dataclass(frozen=True, slots=True, eq=False)
class Validation:
    """Predictions of several sheets, and of two baselines, for some logs."""

    logs: tuple[Log, ...]
    windows: int
    channels: tuple[str, ...]
    """Measured channels."""
    predictions: tuple[Prediction, ...]
    """Predictions in this order: first state held, constant velocity, then each sheet."""
    remarks: tuple[str, ...] = field(default=())

    def skill(self, prediction: Prediction) -> float:
        """Return the mean ratio of the RMS error to the RMS error of holding the first state; lower is better.

        The mean is the geometric mean over channels and horizons.
        """
        hold = self.predictions[0].rms()
        ratio = prediction.rms() / np.where(hold > 0.0, hold, np.nan)
        ratio = ratio[np.isfinite(ratio) & (ratio > 0.0)]
        return float(np.exp(np.mean(np.log(ratio)))) if ratio.size else float("nan")


def horizons(logs: Sequence[Log]) -> Windows:
    """Return windows with one row for each prediction horizon.

    A measurement at a horizon is interpolated between the measurements before and after it. It is left out if the channel's interval
    between measurements is longer than the horizon.

    Raises:
        LogError: no window fits.
    """
    motions = tuple(motion.of_log(log) for log in logs)
    stride = max(STRIDE, sum(log.duration for log in logs) / MOST)
    number, start, state, measured = [], [], [], []
    for k, log in enumerate(logs):
        known = motion.interpolated(log)
        for first, last in log.segments:
            time = log.time[first:last]
            at = time[0]
            while at < time[-1] - HORIZONS[0]:
                row = first + int(np.searchsorted(time, at - 1e-9))
                t0 = log.time[row]
                values = np.full((len(HORIZONS), len(CHANNELS)), np.nan)
                for h, horizon in enumerate(HORIZONS):
                    if t0 + horizon > time[-1] + 1e-9:
                        continue
                    for index, name in enumerate(CHANNELS):
                        if log.has(name) and log.interval(name) <= horizon + 1e-9:
                            values[h, index] = np.interp(t0 + horizon, time, known[first:last, index])
                number.append(k)
                start.append(t0)
                state.append(motions[k].state[row])
                measured.append(values)
                at = max(at + stride, t0 + 1e-6)
    if not start:
        raise LogError(f"{logs[0].name}: no window of {HORIZONS[0]:g} s; record longer")
    return Windows(
        logs=tuple(logs),
        motions=motions,
        length=HORIZONS[-1],
        step=step_of(logs),
        log=np.array(number, dtype=np.int64),
        start=np.array(start),
        state=np.array(state),
        time=np.tile(np.array(HORIZONS), (len(start), 1)),
        measured=np.array(measured),
        channels=tuple(k for k, name in enumerate(CHANNELS) if any(log.has(name) for log in logs)),
        tumbling=tumbles(motions, logs, number, np.array(start), HORIZONS[-1]),
    )


def validate(
    logs: Sequence[Log], vehicles: Sequence[tuple[str, VehicleModel, Identified | None]], *, seed: int = 0
) -> Validation:
    """Return the prediction errors on logs if the first state is held, if the velocity stays constant, and with each sheet.

    Args:
        logs: logs of one vehicle.
        vehicles: name, vehicle and identification of each sheet.
        seed: seed of the draws for bands.

    Raises:
        LogError: the inputs do not fit a vehicle, or no window fits.
    """
    windows = horizons(logs)
    predictions = [
        _held(windows),
        Prediction(CONSTANT, windows.error(_constant(windows))),
    ]
    for name, vehicle, identified in vehicles:
        predictor = Predictor(windows, vehicle)
        delay = {"delay": identified.delay} if identified else {}
        predicted = predictor.states(delay)
        band = _band(predictor, predicted, identified, seed) if identified else None
        predictions.append(Prediction(name, windows.error(predicted), band))
    remarks = tuple(dict.fromkeys(remark for log in logs for remark in log.remarks))
    return Validation(
        tuple(logs), windows.n, tuple(CHANNELS[k] for k in windows.channels), tuple(predictions), remarks
    )


def _held(windows: Windows) -> Prediction:
    return Prediction(HOLD, windows.error(np.broadcast_to(windows.state[:, None], windows.measured.shape)))


def _constant(windows: Windows) -> FloatArray:
    """Return the states (n, horizons, 12) of vehicles that keep their velocity and rates."""
    state = np.repeat(windows.state[:, None], windows.time.shape[1], axis=1)
    rotation = frames.rotation(frames.quaternion(windows.state[:, 3:6]))
    velocity = np.einsum("nij,nj->ni", rotation, windows.state[:, 6:9])
    roll, pitch = windows.state[:, 3], windows.state[:, 4]
    p, q, r = windows.state[:, 9:].T
    around = np.sin(roll) * q + np.cos(roll) * r
    cosine = np.maximum(np.cos(pitch), 0.1)
    # Derivatives of roll, pitch and yaw (Fossen 2011, eq. 2.28).
    turn = np.column_stack(
        [p + np.tan(np.clip(pitch, -1.4, 1.4)) * around, np.cos(roll) * q - np.sin(roll) * r, around / cosine]
    )
    state[..., :3] += velocity[:, None] * windows.time[..., None]
    state[..., 3:6] += turn[:, None] * windows.time[..., None]
    return np.asarray(state)


def _band(predictor: Predictor, predicted: FloatArray, identified: Identified, seed: int) -> FloatArray:
    """Return the half widths (n, horizons, 12) of the bands of an identified sheet.

    A half width combines the error on the logs from which the sheet was identified with the spread of vehicles drawn from the sheet.
    """
    base = np.full((len(HORIZONS), len(CHANNELS)), np.nan)
    for channel, row in identified.errors.items():
        for horizon, error in row.items():
            if channel in CHANNELS and horizon in HORIZONS:
                base[HORIZONS.index(horizon), CHANNELS.index(channel)] = error
    drawn = [relative(identified, draw) for draw in identified.draws(DRAWS, np.random.default_rng(seed))]
    states = predictor.many(drawn)
    spread = np.sqrt(np.mean(predictor.windows.error(states, predicted) ** 2, axis=0))
    # 1.645: the 90 % quantile of a normal error's absolute value.
    return np.asarray(np.sqrt(base**2 + (1.645 * np.nan_to_num(spread, nan=0.0, posinf=1e3)) ** 2))


def relative(identified: Identified, draw: dict[str, float]) -> dict[str, float]:
    """Return a drawn vehicle's numbers, with thrust and gains relative to the fitted values, which the sheet already contains."""
    fitted = dict(zip(identified.parameters, identified.values(identified.fitted).tolist(), strict=True))
    values = dict(draw)
    for name in draw:
        if name.partition(".")[0] in ("thrust", "gain"):
            values[name] = draw[name] / fitted[name]
    return values


def share_of_holding(
    logs: Sequence[Log], vehicle: VehicleModel, values: Mapping[str, float], horizon: float = 1.0
) -> dict[str, float]:
    """Return, by channel, the ratio of a vehicle's RMS error after `horizon` s to the RMS error of holding the first state."""
    windows, h = horizons(logs), HORIZONS.index(horizon)
    own = Prediction("", windows.error(Predictor(windows, vehicle).states(dict(values)))).rms()[h]
    held = _held(windows).rms()[h]
    return {CHANNELS[k]: float(own[k] / held[k]) for k in windows.channels if held[k] > 0.0}


def quantiles(
    logs: Sequence[Log], vehicle: VehicleModel, values: Mapping[str, float]
) -> dict[str, dict[float, float]]:
    """Return the 90 % quantiles of the absolute errors of a vehicle's predictions on logs, by channel and horizon in s."""
    windows = horizons(logs)
    error = np.abs(windows.error(Predictor(windows, vehicle).states(dict(values))))
    table: dict[str, dict[float, float]] = {}
    for index in windows.channels:
        for h, horizon in enumerate(HORIZONS):
            present = error[:, h, index][np.isfinite(error[:, h, index])]
            if present.size >= FEWEST:
                table.setdefault(CHANNELS[index], {})[horizon] = float(np.quantile(present, BAND))
    return table

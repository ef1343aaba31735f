"""Cut logs into windows, and predict each window with the compiled model from the window's first state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from auvbench.dynamics import frames
from auvbench.dynamics.compiled import compiled
from auvbench.dynamics.layout import LANES
from auvbench.identification import inputs as actuation
from auvbench.identification import motion
from auvbench.identification.log import ATTITUDE, CHANNELS, STEEP, Log
from auvbench.identification.parameters import gains, with_values
from auvbench.simulators.fossen import FossenSimulator
from auvbench.vehicles.actuators import Actuator, Thruster
from auvbench.vehicles.curves import Curve, Lag
from auvbench.vehicles.vehicle_model import VehicleModel

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

SHORTEST_STEP, LONGEST_STEP = 0.02, 0.05
"""Shortest and longest time in s between two changes of the input in a prediction."""
SUBSTEP = 0.025
"""Longest physics step in s."""
MOST_LANES = 4096
"""Largest number of vehicles that are simulated together."""
CHECKS = 40
"""Largest number of measurements in a window that are compared with predictions."""
TUMBLING = np.radians(60.0)
"""Tilt in rad from which attitudes are compared by the rotation between them."""


@dataclass(frozen=True, slots=True, eq=False)
class Windows:
    """n windows of some logs, each with up to m rows in which predictions are compared with measurements."""

    logs: tuple[Log, ...]
    motions: tuple[motion.Motion, ...]
    length: float
    """Length of a window in s."""
    step: float
    """Time in s between two changes of the input in a prediction."""
    log: IntArray
    """(n,) index of each window's log."""
    start: FloatArray
    """(n,) time of each window's first row, s."""
    state: FloatArray
    """(n, 12) state of the vehicle in each window's first row."""
    time: FloatArray
    """(n, m) time of each row after the start, s."""
    measured: FloatArray
    """(n, m, 12) measurements in the rows; NaN where nothing was measured or the window has fewer rows than m."""
    channels: tuple[int, ...]
    """Indices of the channels that at least one log measured."""
    tumbling: NDArray[np.bool_]
    """(n,) whether the vehicle's tilt exceeds `TUMBLING`, in logs with roll, pitch and yaw."""

    @property
    def n(self) -> int:
        """Return the number of windows."""
        return int(self.start.size)

    def error(self, states: FloatArray, others: FloatArray | None = None) -> FloatArray:
        """Return states (..., n, m, 12) less the measurements, or less other states.

        In tumbling windows, the errors of roll, pitch and yaw are `motion.turns`.
        """
        others = self.measured if others is None else others
        error = states - others
        if self.tumbling.any():
            others = np.broadcast_to(others, error.shape)
            error[..., self.tumbling, :, ATTITUDE] = motion.turns(
                np.broadcast_to(states, error.shape)[..., self.tumbling, :, ATTITUDE],
                others[..., self.tumbling, :, ATTITUDE],
            )
        return np.asarray(error)


def cut(logs: Sequence[Log], length: float, stride: float | None = None) -> Windows:
    """Return windows of `length` s, one every `stride` s (default: `length`); no window crosses a gap."""
    motions = tuple(motion.of_log(log) for log in logs)
    pieces: list[tuple[int, IntArray]] = []
    for number, log in enumerate(logs):
        there: NDArray[np.bool_] = np.asarray(np.isfinite(log.measured).any(axis=1))
        for first, last in log.segments:
            rows = first + np.flatnonzero(there[first:last])
            pieces += [(number, piece) for piece in _pieces(log.time[rows], rows, length, stride or length)]
    thinned = [(number, rows[:: max(1, -(-rows.size // CHECKS))]) for number, rows in pieces]
    most = max((rows.size for _, rows in thinned), default=1)
    n = len(thinned)
    time, measured = np.zeros((n, most)), np.full((n, most, len(CHANNELS)), np.nan)
    start, state = np.zeros(n), np.zeros((n, len(CHANNELS)))
    for k, (number, rows) in enumerate(thinned):
        log = logs[number]
        start[k], state[k] = log.time[rows[0]], motions[number].state[rows[0]]
        time[k, : rows.size] = log.time[rows] - start[k]
        measured[k, : rows.size] = log.measured[rows]
    measured[:, 0] = np.nan  # The first row is the start itself.
    tumbling = tumbles(motions, logs, [number for number, _ in thinned], start, length)
    # The rotation between two attitudes needs all three angles.
    partly = np.isnan(measured[..., ATTITUDE]).any(axis=-1) & tumbling[:, None]
    measured[..., ATTITUDE] = np.where(partly[..., None], np.nan, measured[..., ATTITUDE])
    steep = (np.abs(measured[..., 4:5]) > STEEP) & ~tumbling[:, None, None]
    measured[..., [3, 5]] = np.where(steep, np.nan, measured[..., [3, 5]])
    return Windows(
        logs=tuple(logs),
        motions=motions,
        length=length,
        step=step_of(logs),
        log=np.array([number for number, _ in thinned], dtype=np.int64),
        start=start,
        state=state,
        time=time,
        measured=measured,
        channels=tuple(k for k, name in enumerate(CHANNELS) if any(log.has(name) for log in logs)),
        tumbling=tumbling,
    )


def tumbles(
    motions: Sequence[motion.Motion],
    logs: Sequence[Log],
    number: Sequence[int],
    start: FloatArray,
    length: float,
) -> NDArray[np.bool_]:
    """Return, for each window, whether the vehicle tumbles in the window, (n,).

    Args:
        motions: states of each log.
        logs: logs.
        number: index of each window's log, (n,).
        start: time at the start of each window in s, (n,).
        length: length of a window, s.
    """
    upright = []
    for log, states in zip(logs, motions, strict=True):
        roll, pitch, _ = states.state[:, ATTITUDE].T
        whole = all(source == "measured" for source in states.source[ATTITUDE])
        upright.append(np.cos(roll) * np.cos(pitch) if whole else np.ones(log.time.size))
    found = []
    for k, at in zip(number, start.tolist(), strict=True):
        first, last = np.searchsorted(logs[k].time, [at - 1e-9, at + length + 1e-9])
        found.append(bool(upright[k][first:last].min() < np.cos(TUMBLING)))
    return np.array(found, dtype=np.bool_)


def step_of(logs: Sequence[Log]) -> float:
    """Return the time in s between two changes of the input in predictions: half the interval between measurements, within bounds."""
    intervals = [float(np.median(np.diff(log.time[np.isfinite(log.measured).any(axis=1)]))) for log in logs]
    return min(LONGEST_STEP, max(SHORTEST_STEP, 0.5 * min(intervals)))


def _pieces(time: FloatArray, rows: IntArray, length: float, stride: float) -> list[IntArray]:
    """Return the rows of each window of a segment.

    A window has at least four rows, and starts more than half its length before the end of the segment.
    """
    pieces = []
    at = float(time[0]) if time.size else 0.0
    while time.size and at < time[-1] - 0.5 * length:
        first, last = np.searchsorted(time, [at - 1e-9, at + length + 1e-9])
        if last - first >= 4:
            pieces.append(rows[first:last])
        at += stride
    return pieces


class Predictor:
    """Predictions of one vehicle for some windows.

    Args:
        windows: windows to predict.
        vehicle: vehicle whose sheet gives all numbers that a prediction's `values` do not contain.

    Raises:
        LogError: a log's inputs do not fit the vehicle.
    """

    def __init__(self, windows: Windows, vehicle: VehicleModel) -> None:
        self.windows = windows
        self.vehicle = vehicle
        self.by_wrench = windows.logs[0].kind == "wrench"
        self.steps = max(1, int(np.ceil(windows.length / windows.step - 1e-9)))
        # Larger than any input, so that the compiled model clips no input.
        self._factors = np.array([4.0 * max(1e-9, *map(abs, unit.curve.limits)) for unit in vehicle.units])
        self._held: dict[tuple[float, float | None, float | None], tuple[FloatArray, list[FloatArray]]] = {}
        self._late: FloatArray | None = None

    def delay(self, late: FloatArray) -> None:
        """Delay the inputs of each step of each window by `late` (n, steps), in s."""
        self._late = late
        self._held.clear()

    def states(self, values: dict[str, float], state: FloatArray | None = None) -> FloatArray:
        """Return the predicted states (n, m, 12) in the rows of the windows.

        Args:
            values: numbers that differ from the sheet's numbers, named as in `parameters.known`.
            state: (n, 12) first states; default: the windows' first states.
        """
        return np.asarray(self.many([values], [state])[0])

    def many(
        self, values: Sequence[dict[str, float]], states: Sequence[FloatArray | None] | None = None
    ) -> FloatArray:
        """Return the predicted states (k, n, m, 12) for k sets of numbers and of first states, simulated together."""
        first = [self.windows.state if state is None else state for state in states or [None] * len(values)]
        padded = -(-self.windows.n // LANES) * LANES
        group = max(1, MOST_LANES // padded)
        parts = [
            self._some(values[k : k + group], first[k : k + group], padded)
            for k in range(0, len(values), group)
        ]
        return np.concatenate(parts)

    def later(
        self, values: dict[str, float], state: FloatArray, seconds: float, pieces: Sequence[slice]
    ) -> FloatArray:
        """Return k sets of predicted states (k, n, m, 12): in set i, the inputs in `pieces[i]` of the steps are `seconds` later."""
        vehicle = with_values(self.vehicle, values)
        means, now = self._inputs(vehicle, values)
        late, _ = self._inputs(vehicle, {**values, "delay": values.get("delay", 0.0) + seconds})
        inputs = []
        for piece in pieces:
            changed = means.copy()
            changed[:, piece] = late[:, piece]
            inputs.append((changed, now))
        padded = -(-self.windows.n // LANES) * LANES
        group = max(1, MOST_LANES // padded)
        return np.concatenate(
            [
                self._some([values] * len(some), [state] * len(some), padded, some)
                for some in (inputs[k : k + group] for k in range(0, len(inputs), group))
            ]
        )

    def _some(
        self,
        values: Sequence[dict[str, float]],
        first: Sequence[FloatArray],
        padded: int,
        inputs: Sequence[tuple[FloatArray, list[FloatArray]]] = (),
    ) -> FloatArray:
        """Do the work of `many` for sets of numbers that fit into one batch; each set has `padded` vehicles.

        `inputs` has, for each set, inputs as `_inputs` returns them; default: the result of `_inputs` for the set.
        """
        vehicles = [with_values(self.vehicle, some) for some in values]
        inputs = inputs or [
            self._inputs(vehicle, some) for vehicle, some in zip(vehicles, values, strict=True)
        ]
        k, n = len(values), self.windows.n

        def spread(arrays: Sequence[FloatArray]) -> FloatArray:
            whole = np.zeros((k, padded, *arrays[0].shape[1:]))
            whole[:, :n] = np.stack(arrays)
            return whole.reshape(k * padded, *arrays[0].shape[1:])

        units = self._units(vehicles[0])
        simulator = FossenSimulator(replace(self.vehicle, units=units), k * padded, SUBSTEP)
        simulator.load_bodies(vehicles)
        start = spread(first)
        simulator.pose[:] = np.column_stack([start[:, :3], frames.quaternion(start[:, 3:6])])
        simulator.velocity[:] = start[:, 6:]
        command = spread([means for means, _ in inputs])
        if self.by_wrench:
            action = np.zeros((k * padded, 0))
        else:
            command = command / self._factors
            simulator.effectiveness[:] = spread(
                [np.tile(gains(self.vehicle, some), (n, 1)) for some in values]
            )
            simulator.actuators[:] = spread([self._actuator_states(units, now) for _, now in inputs])
        grid = np.empty((self.steps + 1, k * padded, 13))
        grid[0] = np.column_stack([simulator.pose, simulator.velocity])
        for step in range(self.steps):
            if self.by_wrench:
                simulator.external_wrench[:] = command[:, step]
            else:
                action = command[:, step]
            simulator.step(action, self.windows.step)
            grid[step + 1, :, :7], grid[step + 1, :, 7:] = simulator.pose, simulator.velocity
        lanes = np.arange(k * padded).reshape(k, padded)[:, :n]
        return self._sampled(grid, start, lanes)

    def _units(self, vehicle: VehicleModel) -> tuple[Actuator, ...]:
        """Return actuators whose command is their quantity divided by a factor, without first-order lags, which `_inputs` applies."""
        if self.by_wrench:
            return ()
        return tuple(
            replace(
                unit,
                curve=Curve("polynomial", (-factor, factor), coefficients=np.array([0.0, factor])),
                lag=Lag.none() if _lagged(unit) else unit.lag,
                resting=np.zeros(0) if _lagged(unit) else unit.rest,
            )
            for unit, factor in zip(vehicle.units, self._factors.tolist(), strict=True)
        )

    def _inputs(self, vehicle: VehicleModel, values: dict[str, float]) -> tuple[FloatArray, list[FloatArray]]:
        """Return the mean inputs (n, steps, n_u) of each step, and for each log the inputs (n_k, n_u) at its windows' starts."""
        delay, voltage = values.get("delay", 0.0), values.get("voltage")
        key = delay, voltage, values.get("lag")
        if key not in self._held:
            if len(self._held) > 8:
                self._held.clear()
            self._held[key] = self._averaged(vehicle, delay, voltage)
        return self._held[key]

    def _averaged(
        self, vehicle: VehicleModel, delay: float, voltage: float | None
    ) -> tuple[FloatArray, list[FloatArray]]:
        windows = self.windows
        lags = np.array([-1.0 / unit.lag.A[0, 0] if _lagged(unit) else 0.0 for unit in vehicle.units])
        edges = windows.step * np.arange(self.steps + 1) - delay
        now: list[FloatArray] = []
        command = np.empty((0, 0, 0))
        for number, log in enumerate(windows.logs):
            values = log.inputs if self.by_wrench else actuation.quantities(log, self.vehicle, voltage)
            own = np.flatnonzero(windows.log == number)
            held = Held(log.time, values, np.zeros(6) if self.by_wrench else lags)
            if not command.size:
                command = np.empty((windows.n, self.steps, values.shape[1]))
            if self._late is None:
                command[own] = held.means(windows.start[own, None] + edges)
            else:
                ends = windows.start[own, None, None] + np.stack([edges[:-1], edges[1:]], axis=-1)
                command[own] = held.means(ends - self._late[own, :, None])[..., 0, :]
            now.append(held.at(windows.start[own] - delay))
        return command, now

    def _actuator_states(self, units: Sequence[Actuator], now: list[FloatArray]) -> FloatArray:
        """Return the steady states (n, n_states) of actuators with dynamics for the inputs at the starts of the windows."""
        windows = self.windows
        inputs = np.zeros((windows.n, len(units)))
        for number, values in enumerate(now):
            inputs[windows.log == number] = values
        columns = [np.zeros((windows.n, 0))]
        for a, unit in enumerate(units):
            if unit.rate > 0.0:
                columns.append(inputs[:, a : a + 1])
            elif unit.lag.order:
                columns.append(np.stack([unit.lag.steady(value) for value in inputs[:, a].tolist()]))
            elif unit.rest.size:
                columns.append(np.tile(unit.rest, (windows.n, 1)))
        return np.concatenate(columns, axis=1)

    def _sampled(self, grid: FloatArray, start: FloatArray, lanes: IntArray) -> FloatArray:
        """Return the states (k, n, m, 12) at the windows' rows.

        Args:
            grid: (steps + 1, vehicles, 13) poses and velocities.
            start: (vehicles, 12) first states.
            lanes: (k, n) index of the vehicle for each set and window.
        """
        place = np.clip(self.windows.time / self.windows.step, 0.0, self.steps)
        below = np.minimum(place.astype(int), self.steps - 1)
        share = (place - below)[..., None]
        angles = np.unwrap(frames.euler(grid[:, :, 3:7]), axis=0)
        angles += start[:, 3:6] - angles[0]
        whole = np.concatenate([grid[:, :, :3], angles, grid[:, :, 7:]], axis=2)
        return np.asarray(
            (1.0 - share) * whole[below, lanes[..., None]] + share * whole[below + 1, lanes[..., None]]
        )


def _lagged(unit: Actuator) -> bool:
    """Return whether an actuator has a first-order lag, which `Held` computes exactly."""
    return unit.lag.order == 1 and unit.rate == 0.0 and isinstance(unit, Thruster)


@compiled()
def _follow(state: FloatArray, keep: FloatArray) -> None:
    """Replace inputs (T, n_u) in place by the states of first-order lags with these inputs.

    In each step, the difference between state and input decays by the factor `keep` (T - 1, n_u).
    """
    inputs = state.copy()
    for k in range(keep.shape[0]):
        for a in range(keep.shape[1]):
            state[k + 1, a] = inputs[k, a] + keep[k, a] * (state[k, a] - inputs[k, a])


class Held:
    """Lagged inputs: inputs (T, n_u), each constant from its row to the next row, that pass through a first-order lag.

    Values and means are continuous in time, so that a delay has a derivative. With the lag tau x' = u - x, the area under x is
    the area under u less tau times the change of x.
    """

    def __init__(self, time: FloatArray, values: FloatArray, lags: FloatArray) -> None:
        early, late = time[0] - 1e4, time[-1] + 1e4
        self._time = np.concatenate([[early], time, [late]])
        self._value = np.vstack([values[:1], values, values[-1:]])
        steps = np.diff(self._time)[:, None]
        self._area = np.vstack([np.zeros(values.shape[1]), np.cumsum(self._value[:-1] * steps, axis=0)])
        self._area -= self._area[1]
        self._lags = lags
        self._state = self._value.copy()
        if np.any(lags > 0.0):
            keep = np.exp(-steps / np.where(lags > 0.0, lags, 1e-9))
            _follow(self._state, keep)

    def at(self, time: FloatArray) -> FloatArray:
        """Return the lagged inputs (..., n_u) at times (...)."""
        row = np.clip(np.searchsorted(self._time, time, side="right") - 1, 0, self._time.size - 2)
        since = (time - self._time[row])[..., None]
        value = self._value[row]
        fading = np.exp(-since / np.where(self._lags > 0.0, self._lags, 1e-9))
        return np.asarray(value + np.where(self._lags > 0.0, fading, 0.0) * (self._state[row] - value))

    def means(self, edges: FloatArray) -> FloatArray:
        """Return the means (..., k, n_u) of the lagged inputs between edges (..., k + 1)."""
        areas = np.stack(
            [np.interp(edges, self._time, self._area[:, a]) for a in range(self._area.shape[1])], axis=-1
        )
        if np.any(self._lags > 0.0):
            areas = areas - self._lags * self.at(edges)
        return np.asarray(np.diff(areas, axis=-2) / np.diff(edges, axis=-1)[..., None])

"""Compute weighted residuals of predictions; the first state of each window is also estimated, within its measurement error."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from auvbench.identification.log import CHANNELS, Lasting, Log
from auvbench.identification.motion import UNKNOWN
from auvbench.identification.parameters import Parameter, values_of
from auvbench.identification.windows import Predictor, Windows

FloatArray = NDArray[np.float64]

OWN = len(CHANNELS)
DISTURBED = (3, 4, *range(6, 12))
"""Components of a first state whose effect is simulated: tilt, velocity and rates. Position and yaw only shift a prediction."""
TRUSTED = 0.1
"""Smallest standard deviation of a measured velocity or rate in a first state, as a fraction of the residuals' standard deviation.
The noise is estimated from differences between rows, which do not show slowly changing noise."""
PIECE = 0.5
"""Duration in s of the pieces into which a window is divided. Each piece has its own time error of the inputs, since few commands
change more often."""
LATEST = 1.7
"""Largest time error of inputs in standard deviations: sqrt(3) for a uniform error."""
SMALL = 1e-3
"""Step of finite differences: in SI units for states, and without a unit for normalised parameters."""
FLIPPED = 1.0
"""Largest change of a residual over a step `SMALL` from which a derivative is computed. A larger change means that an attitude error of
half a turn has changed its sign."""
LOST = 1e3
"""Error that replaces the error of a prediction that is not finite."""
FLOORS = (1e-3,) * 3 + (5e-4,) * 3 + (2e-3,) * 3 + (1e-3,) * 3
"""Smallest standard deviation of the residuals of each channel, in SI units."""


NOTHING = Lasting(np.zeros(len(CHANNELS)), np.zeros(len(CHANNELS)), 0.0, 0.0, 0.0)
"""Lasting errors of a log that has only noise: all are 0."""


class Residuals:
    """Residuals of one predictor as a function of normalised parameters.

    The first state of a window is measured with noise, and some logs have lasting errors (`log.Lasting`). In each window, the first state
    and the lasting errors are corrected so that the residuals are smallest. The residuals are linear in the corrections, so each
    evaluation computes the corrections in closed form (Golub and Pereyra, variable projection).

    Attributes:
        sigma: (channels,) standard deviation of the residuals.
        weight: (channels,) share of the residuals that is independent: one over their correlation time in rows.
    """

    def __init__(self, predictor: Predictor, parameters: Sequence[Parameter]) -> None:
        self.predictor = predictor
        self.parameters = tuple(parameters)
        self.windows: Windows = predictor.windows
        self._lasting = tuple(log.lasting for log in self.windows.logs)
        self._has_lasting = any(self._lasting)
        offset = self._sizes(lambda lasting: lasting.offset)
        used = np.isfinite(offset)
        self.channels = [k for k in self.windows.channels if used[:, k].any()]
        self.there = np.isfinite(self.windows.measured[..., self.channels]) & used[:, None, self.channels]
        self._offset = np.where(np.isfinite(offset), offset, 0.0)
        self.sigma = self._first_sigma()
        self.weight = np.ones(len(self.channels))
        self.shift = np.zeros((self.windows.n, len(CHANNELS)))
        """Correction (n, 12) of the first states from which predictions start, in standard deviations."""
        self.wrong = np.zeros((self.windows.n, len(CHANNELS)))
        """Offset (n, 12) of the measurements, in standard deviations; predictions include it."""
        self.late = np.zeros((self.windows.n, len(self._pieces()) if self._has_lasting else 0))
        """Delay (n, pieces) of the inputs, in standard deviations of the time error; predictions include it."""
        self._noise = np.array([_noise(log) for log in self.windows.logs])
        self._spread = self._start_spread()
        self._gain: tuple[FloatArray, FloatArray] | None = None

    def _first_sigma(self) -> FloatArray:
        """Return a first guess of `sigma`: a tenth of each channel's change in a window."""
        change = self.windows.error(self.windows.state[:, None])
        spread = np.sqrt(np.nanmean(change[..., self.channels] ** 2, axis=(0, 1)))
        return np.asarray(np.maximum(0.1 * spread, np.array(FLOORS)[self.channels]))

    def raw(self, x: FloatArray, state: FloatArray | None = None) -> FloatArray:
        """Return prediction less measurement (n, m, channels) in SI units, 0 where nothing was measured."""
        return np.asarray(self._many([x], [state])[0])

    @property
    def state(self) -> FloatArray:
        """Return the first states (n, 12) from which predictions start."""
        return self.windows.state + self.shift * self._spread - self._bias

    @property
    def _bias(self) -> FloatArray:
        """Return the offsets (n, 12) of the measurements in SI units; predictions include them."""
        return self.wrong * self._offset

    def _many(
        self, points: Sequence[FloatArray], states: Sequence[FloatArray | None] | None = None
    ) -> FloatArray:
        """Return `raw` (k, n, m, channels) at k points."""
        starts = [self.state if state is None else state for state in states or [None] * len(points)]
        return self._error(self.predictor.many([values_of(self.parameters, x) for x in points], starts))

    def _error(self, predicted: FloatArray) -> FloatArray:
        """Return predictions (..., n, m, 12) less measurements, of the measured channels, 0 where nothing was measured."""
        if self._has_lasting:
            predicted = predicted + self._bias[:, None]
        error = self.windows.error(predicted)[..., self.channels]
        # A step of the fit may try a vehicle whose dynamics are too fast for any time step.
        return np.where(self.there, np.nan_to_num(error, nan=LOST, posinf=LOST, neginf=-LOST), 0.0)

    def linearise(self, x: FloatArray) -> None:
        """Compute the derivatives of the residuals with respect to first states and lasting errors, at normalised parameters `x`.

        Predictions then start from the corrected first states, so that only small corrections remain, whose effect is linear.
        """
        if self._gain is not None:
            _, z = self.project(self.raw(x))
            now = self._start_spread()
            scale = np.divide(self._spread, now, out=np.zeros_like(now), where=now > 0.0)
            self.shift = np.clip(z[:, :OWN], -5.0, 5.0) * scale
            if self._has_lasting:
                self._allow(z)
        self._spread = self._start_spread()
        moved = []
        for index in DISTURBED:
            state = self.state.copy()
            state[:, index] += SMALL
            moved.append(state)
        base, *others = self._many([x] * (1 + len(moved)), [None, *moved])
        n, m, c = base.shape
        effect = np.zeros((n, m, c, len(CHANNELS)))
        for index, other in zip(DISTURBED, others, strict=True):
            effect[..., index] = _slope(base, other, SMALL)
        for index in (0, 1, 2, 5):  # A shift of a position or of yaw shifts only the same channel.
            if index in self.channels:
                column = self.channels.index(index)
                effect[:, :, column, index] = self.there[..., column]
        scaled = effect * self._spread[:, None, None, :] / self.sigma[:, None]
        G = scaled.reshape(n, m * c, len(CHANNELS))
        if self._has_lasting:
            errors = [error / self.sigma[:, None] for error in self._errors(effect, x)]
            G = np.concatenate([G, *(error.reshape(n, m * c, -1) for error in errors)], axis=-1)
        inverse = np.linalg.inv(np.eye(G.shape[-1]) + np.einsum("nri,nrj->nij", G, G))
        self._gain = G, -np.einsum("nij,nrj->nir", inverse, G)

    def _sizes(self, read: Callable[[Lasting], float | FloatArray]) -> FloatArray:
        """Return, for each window, the value (n, ...) that `read` returns for the lasting errors of the window's log."""
        return np.array([read(lasting or NOTHING) for lasting in self._lasting])[self.windows.log]

    def _errors(self, effect: FloatArray, x: FloatArray) -> list[FloatArray]:
        """Return how much one standard deviation of each offset, drift and time error changes the residuals.

        The result has one array (n, m, channels, k) for the offsets, one for the drifts and one for the times.

        Args:
            effect: (n, m, channels, 12) effect of first states.
            x: normalised parameters.
        """
        own = np.zeros_like(effect)
        for column, index in enumerate(self.channels):
            own[..., column, index] = self.there[..., column]
        drift = self._sizes(lambda lasting: lasting.drift)[:, None, None]
        early = self._sizes(lambda lasting: lasting.early)[:, None, None, None]
        late = np.moveaxis(self._later(x, self._pieces()), 0, -1)
        # A first state comes from the measurements, so it has the same offset as the measurements.
        return [
            (own - effect) * self._offset[:, None, None],
            self.windows.time[..., None, None] * own * drift,
            late * early,
        ]

    def _allow(self, z: FloatArray) -> None:
        """Include the offsets and delays of `z` (n, `corrections`) in the predictions, so that later corrections are small."""
        self.wrong = np.clip(z[:, OWN : 2 * OWN], -5.0, 5.0)
        self.late = np.clip(z[:, 3 * OWN :], -LATEST, LATEST)
        late = np.zeros((self.windows.n, self.predictor.steps))
        for column, piece in enumerate(self._pieces()):
            late[:, piece] = self.late[:, column, None]
        self.predictor.delay(late * self._sizes(lambda lasting: lasting.early)[:, None])

    def _pieces(self) -> list[slice]:
        """Return the pieces into which the steps of a window are divided; each piece has its own time error of the inputs."""
        width = max(1, round(PIECE / self.windows.step))
        return [slice(first, first + width) for first in range(0, self.predictor.steps, width)]

    def _later(self, x: FloatArray, pieces: Sequence[slice]) -> FloatArray:
        """Return the derivatives (k, n, m, channels) of the residuals with respect to a delay in s of the inputs in each of k pieces."""
        values = values_of(self.parameters, x)
        base, *others = self.predictor.later(values, self.state, SMALL, [slice(0, 0), *pieces])
        return np.stack(
            [
                np.where(self.there, _slope(self._error(base), self._error(other), SMALL), 0.0)
                for other in others
            ]
        )

    def of_whole_logs(self, x: FloatArray) -> FloatArray:
        """Return how much one standard deviation of each error that all logs share changes `vector`, (rows, errors).

        The effect of corrections is taken from the last linearisation. The time error of all outputs and the error of the depth scale
        belong to a vehicle's autopilot, so that more logs do not reduce them.
        """
        if not self._has_lasting:
            return np.zeros((self.weights().size, 0))
        early = self._sizes(lambda lasting: lasting.all_early)[:, None, None]
        scale = self._sizes(lambda lasting: lasting.depth_scale)[:, None, None]
        changes = early * self._later(x, [slice(None)])[0], scale * self._deeper(x)
        return np.column_stack([self.vector(change, np.zeros_like(x), change=True) for change in changes])

    def _deeper(self, x: FloatArray) -> FloatArray:
        """Return the derivative of the residuals (n, m, channels) with respect to the scale of the depth."""
        state = self.state.copy()
        state[:, 8] *= 1.0 + SMALL
        base, other = self._many([x, x], [None, state])
        change = _slope(base, other, SMALL)
        moved = (
            self.windows.measured - np.where(np.arange(len(CHANNELS)) < 3, self.windows.state, 0.0)[:, None]
        )
        for index in (2, 8):
            if index in self.channels:
                column = self.channels.index(index)
                change[..., column] -= np.where(self.there[..., column], moved[..., index], 0.0)
        return change

    def _start_spread(self) -> FloatArray:
        """Return standard deviations (n, 12) of the first states.

        Where the model is wrong, residuals are larger than the noise. If a first rate could vary as much as the residuals, it would bend
        each prediction towards the measurements, and hide the error of the model.
        """
        noise = np.array(FLOORS)
        noise[self.channels] = self.sigma
        table = np.zeros((len(self.windows.motions), len(CHANNELS)))
        for row, motion, own in zip(table, self.windows.motions, self._noise, strict=True):
            for index, source in enumerate(motion.source):
                if source == "measured":
                    row[index] = noise[index]
                    if index >= 6:
                        row[index] = min(max(own[index], TRUSTED * noise[index]), noise[index])
                elif index >= 6:
                    size = float(np.std(motion.state[:, index]))
                    derived = motion.spread[index] * noise[index - 6] + 0.3 * size
                    row[index] = derived if source == "derived" else UNKNOWN
        return table[self.windows.log]

    @property
    def corrections(self) -> int:
        """Return the number of corrections of a window."""
        assert self._gain is not None
        return int(self._gain[0].shape[-1])

    def project(self, raw: FloatArray, change: bool = False) -> tuple[FloatArray, FloatArray]:
        """Return the corrected residuals (n, m * channels) in standard deviations, and the corrections (n, `corrections`).

        Args:
            raw: (n, m, channels) as from `raw`.
            change: whether `raw` is a change of residuals; the corrections that predictions include are then not subtracted.
        """
        assert self._gain is not None
        G, K = self._gain
        r = (raw / self.sigma).reshape(raw.shape[0], -1)
        if not change:
            r = r - np.einsum("nri,ni->nr", G[..., :OWN], self.shift)
            if self._has_lasting:
                r = r - np.einsum("nri,ni->nr", G[..., OWN : 2 * OWN], self.wrong)
                r = r - np.einsum("nri,ni->nr", G[..., 3 * OWN :], self.late)
        z = np.einsum("nir,nr->ni", K, r)
        return r + np.einsum("nri,ni->nr", G, z), z

    def vector(self, raw: FloatArray, x: FloatArray, change: bool = False) -> FloatArray:
        """Return one vector of all residuals: of the windows, of the corrections, and of the prior."""
        r, z = self.project(raw, change)
        return np.concatenate([r.ravel(), z.ravel(), x])

    def weights(self) -> FloatArray:
        """Return the weight of each entry of `vector`."""
        n, m, c = self.there.shape
        return np.concatenate(
            [
                np.broadcast_to(self.weight, (n, m, c)).ravel(),
                np.full(n * self.corrections, float(self.weight.mean())),
                np.ones(len(self.parameters)),
            ]
        )

    def jacobian(self, x: FloatArray, free: Sequence[int]) -> FloatArray:
        """Return the derivatives of `vector` (rows, free parameters) by finite differences."""
        steps = np.array([SMALL if x[k] + SMALL <= self.parameters[k].range()[1] else -SMALL for k in free])
        unit = np.eye(x.size)
        base, *others = self._many([x, *(x + step * unit[k] for step, k in zip(steps, free, strict=True))])
        return np.column_stack(
            [
                self.vector(_slope(base, other, step), unit[k], change=True)
                for other, step, k in zip(others, steps, free, strict=True)
            ]
        )

    def robust(self, r: FloatArray) -> FloatArray:
        """Return the weights (rows,) with which a sum of squares of `vector` has the gradient of the soft-L1 loss (Charbonnier 1994)."""
        split = self.there.size
        weights = self.weights()
        weights[:split] /= np.sqrt(1.0 + r[:split] ** 2)
        return weights

    def loss(self, x: FloatArray) -> float:
        """Return half the weighted sum of the residuals' soft-L1 losses and of the squares of corrections and prior."""
        r = self.vector(self.raw(x), x)
        split = self.there.size
        rho = np.concatenate([2.0 * (np.sqrt(1.0 + r[:split] ** 2) - 1.0), r[split:] ** 2])
        return 0.5 * float(self.weights() @ rho)

    def rescale(self, x: FloatArray) -> None:
        """Set `sigma` and `weight` from the residuals at `x`."""
        r, _ = self.project(self.raw(x))
        r = r.reshape(self.there.shape)
        for column in range(len(self.channels)):
            there = self.there[..., column]
            values = r[..., column][there]
            spread = 1.4826 * float(np.median(np.abs(values)))
            floor = FLOORS[self.channels[column]]
            self.sigma[column] = max(self.sigma[column] * spread, floor)
            # Var(sum over a window) / (n Var) is the number of rows that share one independent value.
            limited = np.clip(r[..., column] / max(spread, 1e-12), -3.0, 3.0)
            sums = np.sum(limited, axis=1)
            power = float(np.sum(limited**2))
            together = float(np.sum(sums**2)) / power if power > 0.0 else 1.0
            self.weight[column] = 1.0 / max(1.0, together)


def _noise(log: Log) -> FloatArray:
    """Return the standard deviation (12,) of each channel's noise from row to row; infinite for a channel that was not measured.

    The second difference of white noise has six times the variance of the noise.
    """
    found = np.full(len(CHANNELS), np.inf)
    for index, column in enumerate(log.measured.T):
        second = np.diff(column[np.isfinite(column)], 2)
        if second.size:
            found[index] = np.sqrt(np.pi / 2.0 / 6.0) * np.abs(second).mean()
    return found


def _slope(base: FloatArray, other: FloatArray, step: float) -> FloatArray:
    """Return the derivative of residuals, computed as a finite difference; 0 where the residual changes by more than `FLIPPED`."""
    change = other - base
    return np.asarray(np.where(np.abs(change) > FLIPPED, 0.0, change) / step)

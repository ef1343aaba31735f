"""Weighted residuals of predictions, with the first state of each window free within its measurement error."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from auvbench.identification.log import CHANNELS, Log
from auvbench.identification.parameters import Parameter, values_of
from auvbench.identification.windows import Predictor, Windows

FloatArray = NDArray[np.float64]

DISTURBED = (3, 4, *range(6, 12))
"""First states whose effect is simulated: tilt, velocity and rates. Position and yaw only shift a prediction."""
TRUSTED = 0.1
"""Smallest standard deviation of a measured velocity or rate at a start, as a share of that of the residuals. Noise that changes
slowly hides between two rows."""
SMALL = 1e-3
"""Step of finite differences, of states in SI units and of normalised parameters."""
FLIPPED = 1.0
"""Change of a residual over `SMALL` that is no derivative: an attitude error of half a turn changes its sign."""
LOST = 1e3
"""Error of a prediction that is not finite."""
FLOORS = (1e-3,) * 3 + (5e-4,) * 3 + (2e-3,) * 3 + (1e-3,) * 3
"""Smallest standard deviation of a residual of each channel."""


class Residuals:
    """Residuals of one predictor as a function of normalised parameters.

    The first state of a window is measured with noise. Its correction minimises the residuals of the window; it is linear in
    them, and is computed in closed form at each evaluation (Golub and Pereyra, variable projection).

    Attributes:
        sigma: (channels,) standard deviation of the residuals.
        weight: (channels,) share of the residuals that is independent: one over their correlation time in rows.
    """

    def __init__(self, predictor: Predictor, parameters: Sequence[Parameter]) -> None:
        self.predictor = predictor
        self.parameters = tuple(parameters)
        self.windows: Windows = predictor.windows
        self.channels = list(self.windows.channels)
        self.there = np.isfinite(self.windows.measured[..., self.channels])
        self.sigma = self._first_sigma()
        self.weight = np.ones(len(self.channels))
        self.shift = np.zeros((self.windows.n, len(CHANNELS)))
        """Correction (n, 12) of the first states from which predictions start, in standard deviations."""
        self._noise = np.array([_noise(log) for log in self.windows.logs])
        self._spread = self._start_spread()
        self._gain: tuple[FloatArray, FloatArray] | None = None

    def _first_sigma(self) -> FloatArray:
        """Return a tenth of what each channel changes in a window, as a first guess."""
        change = self.windows.error(self.windows.state[:, None])
        spread = np.sqrt(np.nanmean(change[..., self.channels] ** 2, axis=(0, 1)))
        return np.asarray(np.maximum(0.1 * spread, np.array(FLOORS)[self.channels]))

    def raw(self, x: FloatArray, state: FloatArray | None = None) -> FloatArray:
        """Return prediction less measurement (n, m, channels) in SI units, 0 where nothing was measured."""
        return np.asarray(self._many([x], [state])[0])

    @property
    def state(self) -> FloatArray:
        """Return the first states (n, 12) from which predictions start."""
        return self.windows.state + self.shift * self._spread

    def _many(
        self, points: Sequence[FloatArray], states: Sequence[FloatArray | None] | None = None
    ) -> FloatArray:
        """Return `raw` (k, n, m, channels) at k points."""
        starts = [self.state if state is None else state for state in states or [None] * len(points)]
        predicted = self.predictor.many([values_of(self.parameters, x) for x in points], starts)
        error = self.windows.error(predicted)[..., self.channels]
        # A step of the fit may try a vehicle that no time step resolves.
        return np.where(self.there, np.nan_to_num(error, nan=LOST, posinf=LOST, neginf=-LOST), 0.0)

    def linearise(self, x: FloatArray) -> None:
        """Compute how first states act on the residuals (n, m channels, 12), at normalised parameters `x`.

        Predictions then start from the corrected first states, so that their effect need only be linear in what is left.
        """
        if self._gain is not None:
            _, z = self.project(self.raw(x))
            now = self._start_spread()
            scale = np.divide(self._spread, now, out=np.zeros_like(now), where=now > 0.0)
            self.shift = np.clip(z, -5.0, 5.0) * scale
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
        for index in (0, 1, 2, 5):  # A shift of position or yaw only shifts its own channel.
            if index in self.channels:
                column = self.channels.index(index)
                effect[:, :, column, index] = self.there[..., column]
        scaled = effect * self._spread[:, None, None, :] / self.sigma[:, None]
        G = scaled.reshape(n, m * c, len(CHANNELS))
        inverse = np.linalg.inv(np.eye(len(CHANNELS)) + np.einsum("nri,nrj->nij", G, G))
        self._gain = G, -np.einsum("nij,nrj->nir", inverse, G)

    def _start_spread(self) -> FloatArray:
        """Return standard deviations (n, 12) of the first states.

        Residuals are larger than the noise where the model is wrong. A first rate that is as free would bend each prediction
        towards its window, and hide what is wrong.
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
                    row[index] = derived if source == "derived" else 0.3
        return table[self.windows.log]

    def project(self, raw: FloatArray, change: bool = False) -> tuple[FloatArray, FloatArray]:
        """Return residuals (n, m channels) in standard deviations after the correction, and corrections (n, 12).

        Args:
            raw: (n, m, channels) as from `raw`.
            change: whether `raw` is a derivative of residuals, which have the same correction of first states.
        """
        assert self._gain is not None
        G, K = self._gain
        r = (raw / self.sigma).reshape(raw.shape[0], -1)
        if not change:
            r = r - np.einsum("nri,ni->nr", G, self.shift)
        z = np.einsum("nir,nr->ni", K, r)
        return r + np.einsum("nri,ni->nr", G, z), z

    def vector(self, raw: FloatArray, x: FloatArray, change: bool = False) -> FloatArray:
        """Return all residuals as a vector: of the windows, of the corrections of first states, of the prior."""
        r, z = self.project(raw, change)
        return np.concatenate([r.ravel(), z.ravel(), x])

    def weights(self) -> FloatArray:
        """Return the weight of each entry of `vector`."""
        n, m, c = self.there.shape
        return np.concatenate(
            [
                np.broadcast_to(self.weight, (n, m, c)).ravel(),
                np.full(n * len(CHANNELS), float(self.weight.mean())),
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
        """Return the weights of the squares of `vector` (rows,) that have the gradient of the soft-L1 loss (Charbonnier 1994)."""
        split = self.there.size
        weights = self.weights()
        weights[:split] /= np.sqrt(1.0 + r[:split] ** 2)
        return weights

    def loss(self, x: FloatArray) -> float:
        """Return half the sum of the soft-L1 loss of the residuals and of the squares of corrections and prior."""
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
    """Return the standard deviation (12,) of the noise from row to row of each channel; infinite where it was not measured.

    The second difference of white noise has six times its variance.
    """
    found = np.full(len(CHANNELS), np.inf)
    for index, column in enumerate(log.measured.T):
        second = np.diff(column[np.isfinite(column)], 2)
        if second.size:
            found[index] = np.sqrt(np.pi / 2.0 / 6.0) * np.abs(second).mean()
    return found


def _slope(base: FloatArray, other: FloatArray, step: float) -> FloatArray:
    """Return a derivative of residuals by a finite difference; 0 where one of the two is lost or turns by more than half a turn."""
    change = other - base
    return np.asarray(np.where(np.abs(change) > FLIPPED, 0.0, change) / step)

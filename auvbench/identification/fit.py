"""Fit numbers of a vehicle sheet to logs by robust least squares with priors; estimate the numbers' covariance by a block bootstrap."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from auvbench.identification.log import CHANNELS, Log, LogError
from auvbench.identification.parameters import Parameter, values_of
from auvbench.identification.residuals import Residuals
from auvbench.identification.windows import Predictor, Windows, cut
from auvbench.vehicles.vehicle_model import VehicleModel

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

IDENTIFIED = 0.5
"""A parameter is identified if its posterior standard deviation is at most this fraction of its prior standard deviation."""
BLOCK = 5.0
"""Shortest duration in s of the blocks that the bootstrap draws; a block is at least as long as two windows."""
ROUNDS = 3
"""Number of successive fits; each fit uses the residuals' standard deviations from the previous fit."""
BOUND = 4.0
"""Largest distance of a parameter from its prior in a fit, in prior standard deviations."""
CONTRADICTED = 2.0
"""Distance of a parameter from its prior, in prior standard deviations, beyond which the log contradicts the sheet. A parameter beyond
this distance is not reset to its prior, even if the log identifies it poorly: other parameters would have to compensate for the reset."""
STEPS = 12
"""Largest number of steps of a fit."""
CONFIDENCE = 0.95


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """A parameter after the fit."""

    parameter: Parameter
    x: float
    """Normalised value of the parameter, as in `Parameter.normalised`."""
    low: float
    """Lower end of the 95 % interval, in the parameter's unit; `high` is the upper end."""
    high: float
    ratio: float
    """Posterior standard deviation divided by prior standard deviation."""
    kept: str = ""
    """Reason why the parameter stays at its prior; '' if the log identifies it."""

    @property
    def value(self) -> float:
        """Return the value of the parameter in its unit."""
        return self.parameter.value(self.x)


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Result of `fit`."""

    vehicle: VehicleModel
    logs: tuple[Log, ...]
    estimates: tuple[Estimate, ...]
    covariance: FloatArray
    """(n_p, n_p) covariance of all normalised parameters, computed as if none were kept at its prior."""
    condition: float
    """Condition number of the Fisher information of the identified parameters, which are measured in prior standard deviations."""
    blocks: int
    """Number of blocks from which the bootstrap draws."""
    windows: Windows
    predicted: FloatArray
    """(n, m, 12) predicted states with the fitted parameters."""
    before: FloatArray
    """(n, m, 12) predicted states with the sheet's numbers."""
    sigma: dict[str, float]
    """Standard deviation of the residuals, by channel."""

    @property
    def numbers(self) -> dict[str, float]:
        """Return the fitted numbers by name."""
        return {estimate.parameter.name: estimate.value for estimate in self.estimates}

    @property
    def x(self) -> FloatArray:
        """Return the normalised parameters (n_p,)."""
        return np.array([estimate.x for estimate in self.estimates])


def window_of(logs: Sequence[Log]) -> float:
    """Return the default length of a window in s: 2 s if a log has velocities or rates, else 5 s; at least eight measurement intervals."""
    fast = any(log.has(name) for log in logs for name in CHANNELS[6:])
    slowest = max(min(log.interval(name) for name in CHANNELS if log.has(name)) for log in logs)
    return max(2.0 if fast else 5.0, 8.0 * slowest)


def fit(
    logs: Sequence[Log],
    vehicle: VehicleModel,
    parameters: Sequence[Parameter],
    *,
    length: float | None = None,
    kept: dict[str, str] | None = None,
    replicates: int = 200,
    seed: int = 0,
    told: Callable[[str], None] = lambda text: None,
) -> Fit:
    """Return the parameters that explain the logs best, and the reasons for which the logs do not identify some of them.

    Args:
        logs: logs of one vehicle.
        vehicle: vehicle whose sheet gives the priors.
        parameters: numbers to fit.
        length: length of a window in s; None: `window_of`.
        kept: reasons by name for parameters that stay at their prior.
        replicates: number of bootstrap replicates.
        seed: seed of the bootstrap.
        told: function called with each line of progress.

    Raises:
        LogError: the inputs do not fit the vehicle, or no window can be cut.
    """
    if len({log.kind == "wrench" for log in logs}) > 1:
        raise LogError(
            f"{logs[0].name}: some logs have wrenches and others commands of thrusters; give only logs of one kind"
        )
    windows = cut(logs, length or window_of(logs))
    if windows.n == 0:
        raise LogError(
            f"{logs[0].name}: no window of {windows.length:g} s with four measurements; record longer, or give"
            " window=SECONDS"
        )
    residuals = Residuals(Predictor(windows, vehicle), parameters)
    reasons = dict(kept or {})
    names = [parameter.name for parameter in parameters]
    x = np.zeros(len(parameters))
    for number in range(ROUNDS):
        free = [k for k, name in enumerate(names) if name not in reasons]
        x = _solve(residuals, x, free, tolerance=1.0 if number < ROUNDS - 1 else 0.005)
        if number < ROUNDS - 1:
            residuals.rescale(x)
        told(f"fit {number + 1} of {ROUNDS}: {len(free)} parameters, {windows.n} windows")
    blocks = _blocks(windows)
    x, sums, condition = _identified(residuals, x, blocks, reasons, told)
    covariance = _resampled(*sums, replicates, seed) if replicates else _covariance(*sums)
    covariance = _widened(covariance, max(log.lasting.factor if log.lasting else 1.0 for log in logs))
    quantile = _quantile(int(blocks.max()) + 1)
    estimates = tuple(
        _estimate(parameter, float(at), float(np.sqrt(variance)), quantile, reasons.get(parameter.name, ""))
        for parameter, at, variance in zip(parameters, x, np.diag(covariance), strict=True)
    )
    sigma = {CHANNELS[k]: float(s) for k, s in zip(residuals.channels, residuals.sigma, strict=True)}
    predictor = Predictor(windows, vehicle)  # new, without the fit's time corrections
    return Fit(
        vehicle=vehicle,
        logs=tuple(logs),
        estimates=estimates,
        covariance=covariance,
        condition=condition,
        blocks=int(blocks.max()) + 1,
        windows=windows,
        predicted=predictor.states(values_of(parameters, x)),
        before=predictor.states({}),
        sigma=sigma,
    )


def _quantile(blocks: int) -> float:
    """Return the half width of the 95 % interval in standard deviations (Student's t), if these are estimated from `blocks` blocks."""
    return float(stats.t.ppf(0.5 + 0.5 * CONFIDENCE, max(1, blocks - 1)))


def information(
    logs: Sequence[Log],
    vehicle: VehicleModel,
    parameters: Sequence[Parameter],
    x: FloatArray,
    noise: Mapping[str, float],
) -> FloatArray:
    """Return the Fisher information (n_p, n_p) of logs about the normalised parameters at `x`.

    `noise` is the standard deviation of the residuals, by channel.
    """
    windows = cut(logs, window_of(logs))
    residuals = Residuals(Predictor(windows, vehicle), parameters)
    residuals.sigma = np.array([noise[CHANNELS[k]] for k in residuals.channels])
    residuals.linearise(x)
    J = residuals.jacobian(x, range(x.size))[: -x.size]
    return np.asarray(J.T @ J)


def _undamped(parameter: Parameter, x: float) -> bool:
    """Return whether a parameter is a damping coefficient at its lower bound. The bound is practically 0, a common true value."""
    return "damping" in parameter.name and x <= parameter.range(BOUND)[0] + 1e-3


def _estimate(parameter: Parameter, x: float, sd: float, quantile: float, kept: str) -> Estimate:
    low, high = parameter.value(x - quantile * sd), parameter.value(x + quantile * sd)
    if _undamped(parameter, x):
        low = 0.0
    return Estimate(parameter, x, low, high, sd, kept)


def _solve(residuals: Residuals, x: FloatArray, free: Sequence[int], tolerance: float = 0.005) -> FloatArray:
    """Minimise the loss over the free parameters by damped Gauss-Newton steps; return all normalised parameters (n_p,).

    Each step linearises the effect of the windows' first states again, so that parameters and first states converge together. The
    trust regions of `scipy.optimize.least_squares` need three times as many steps here, because a delay starts at its bound.
    """
    free = list(free)
    low, high = np.array([parameter.range(BOUND) for parameter in residuals.parameters]).T
    for _ in range(STEPS if free else 0):
        residuals.linearise(x)
        r = residuals.vector(residuals.raw(x), x)
        weights = residuals.robust(r)
        J = residuals.jacobian(x, free)
        gradient = J.T @ (weights * r)
        H = J.T @ (weights[:, None] * J)
        # A parameter at a bound keeps its value if its step would cross the bound.
        inner = [
            k
            for k, at in enumerate(free)
            if not ((x[at] <= low[at] and gradient[k] > 0.0) or (x[at] >= high[at] and gradient[k] < 0.0))
        ]
        step = np.zeros(x.size)
        moved = np.linalg.solve(H[np.ix_(inner, inner)], gradient[inner])
        step[[free[k] for k in inner]] = -moved
        decrease = 0.5 * float(moved @ gradient[inner])
        x, done = _line(residuals, x, step, low, high)
        if not done or decrease < tolerance:
            break
    residuals.linearise(x)
    return x


def _line(
    residuals: Residuals, x: FloatArray, step: FloatArray, low: FloatArray, high: FloatArray
) -> tuple[FloatArray, bool]:
    """Search along the step for a point with a smaller loss than `x`; return the point and True, or `x` and False if none is found."""
    before = residuals.loss(x)
    share = min(1.0, 1.0 / max(float(np.abs(step).max()), 1e-12))
    for _ in range(8):
        point = np.clip(x + share * step, low, high)
        if residuals.loss(point) < before:
            return point, True
        share *= 0.5
    return x, False


def _blocks(windows: Windows) -> IntArray:
    """Return the block (n,) of each window, numbered from 0 without gaps."""
    length = max(BLOCK, 2.0 * windows.length)
    keys = windows.log * 10**6 + np.floor(windows.start / length).astype(np.int64)
    return np.unique(keys, return_inverse=True)[1]


def _sums(residuals: Residuals, x: FloatArray, blocks: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the gradient and the Gauss-Newton matrix of each block, both without the prior, and the effect of shared errors.

    The gradients have shape (blocks, n_p), the matrices (blocks, n_p, n_p). The third result, (errors, n_p), is the change of the
    gradient by one standard deviation of each error that all logs share.
    """
    everything = range(x.size)
    J = residuals.jacobian(x, everything)
    r = residuals.vector(residuals.raw(x), x)
    weights = residuals.robust(r)
    n, size = residuals.windows.n, residuals.there[0].size
    split = n * size
    count = int(blocks.max()) + 1
    gradients, matrices = np.zeros((count, x.size)), np.zeros((count, x.size, x.size))
    for first, width in ((0, size), (split, residuals.corrections)):
        rows = slice(first, first + n * width)
        part = J[rows].reshape(n, width, -1)
        weighted = part * weights[rows].reshape(n, width, 1)
        np.add.at(gradients, blocks, np.einsum("nri,nr->ni", weighted, r[rows].reshape(n, width)))
        np.add.at(matrices, blocks, np.einsum("nri,nrj->nij", weighted, part))
    return gradients, matrices, residuals.of_whole_logs(x).T @ (weights[:, None] * J)


def _covariance(gradients: FloatArray, matrices: FloatArray, errors: FloatArray) -> FloatArray:
    """Return the sandwich covariance (n_p, n_p) of the blocks' gradients, with the errors that all logs share and with the prior."""
    count = len(gradients)
    bread = np.linalg.inv(matrices.sum(axis=0) + np.eye(gradients.shape[1]))
    scatter = gradients - gradients.mean(axis=0)
    meat = scatter.T @ scatter * count / max(1, count - 1) + errors.T @ errors
    return _bounded(bread @ (meat + np.eye(gradients.shape[1])) @ bread, bread)


def _bounded(covariance: FloatArray, bread: FloatArray) -> FloatArray:
    """Return a covariance whose variances are at least the Gauss-Newton variances (in `bread`) and at most the prior variances.

    The bounds are needed because the scatter between blocks is too small if there are few blocks, and too large if the vehicle turns
    over in a block.
    """
    variance = np.clip(np.diag(covariance), np.diag(bread), 1.0)
    ratio = np.sqrt(variance / np.diag(covariance))
    return np.asarray(covariance * np.outer(ratio, ratio))


def _widened(covariance: FloatArray, factor: float) -> FloatArray:
    """Return a covariance with standard deviations multiplied by `factor`, but not beyond the prior standard deviations."""
    ratio = np.minimum(factor, np.maximum(1.0, 1.0 / np.sqrt(np.diag(covariance))))
    return np.asarray(covariance * np.outer(ratio, ratio))


def _identified(
    residuals: Residuals,
    x: FloatArray,
    blocks: IntArray,
    reasons: dict[str, str],
    told: Callable[[str], None],
) -> tuple[FloatArray, tuple[FloatArray, FloatArray, FloatArray], float]:
    """Reset to its prior each parameter that the logs do not identify, one at a time; then refit the remaining parameters.

    Changes `x` and adds the reasons to `reasons`. Returns `x`, the `_sums` of all parameters, and the condition number.
    """
    names = [parameter.name for parameter in residuals.parameters]
    gradients, matrices, errors = _sums(residuals, x, blocks)
    before = len(reasons)
    while True:
        free = [k for k, name in enumerate(names) if name not in reasons]
        if not free:
            break
        covariance = _covariance(gradients[:, free], matrices[:, free][:, :, free], errors[:, free])
        # With few blocks the scatter itself is uncertain, so sd is multiplied by the ratio of Student's to the normal quantile.
        sd = np.sqrt(np.diag(covariance)) * _quantile(len(gradients)) / _quantile(10**6)
        sd[np.abs(x[free]) > CONTRADICTED] = 0.0
        worst = int(np.argmax(sd))
        if sd[worst] <= IDENTIFIED:
            break
        reasons[names[free[worst]]] = _reason(names, free, covariance, worst)
        x[free[worst]] = 0.0
    still = _settled(residuals, x, reasons, dropped=len(reasons) > before)
    if len(reasons) > before:
        gradients, matrices, errors = _sums(residuals, x, blocks)
    total = matrices.sum(axis=0)[np.ix_(still, still)]
    condition = float(np.linalg.cond(total)) if still else float("inf")
    told(f"{len(still)} of {len(names)} parameters identified")
    return x, (gradients, matrices, errors), condition


def _settled(residuals: Residuals, x: FloatArray, reasons: dict[str, str], dropped: bool) -> list[int]:
    """Refit `x` in place if parameters were dropped (reset to their prior) or ran to a bound; return the free parameters' indices."""
    names = [parameter.name for parameter in residuals.parameters]
    while True:
        free = [k for k, name in enumerate(names) if name not in reasons]
        if dropped:
            x[:] = _solve(residuals, x, free)
        at_bound = []
        for k in free:
            low, high = residuals.parameters[k].range(BOUND)
            physical = not residuals.parameters[k].log  # with a physical bound, such as a delay of 0
            undamped = _undamped(residuals.parameters[k], float(x[k]))
            if not physical and not undamped and min(x[k] - low, high - x[k]) < 1e-3:
                at_bound.append(k)
        if not at_bound:
            return free
        for k in at_bound:
            reasons[names[k]] = _at_bound(residuals.parameters[k], float(x[k]))
            x[k] = 0.0
        dropped = True


def _at_bound(parameter: Parameter, x: float) -> str:
    """Return why a parameter at a bound is not identified."""
    if parameter.name.startswith("gain.") and x < 0.0:
        thruster = parameter.name.partition(".")[2]
        return (
            f"the fit ran to its bound, {parameter.value(-BOUND):.2g}: {thruster} hardly pushes as the sheet says, and the other"
            " parameters compensate; correct its gain, position or direction in the sheet"
        )
    return "the fit ran to its bound"


def _reason(names: Sequence[str], free: Sequence[int], covariance: FloatArray, worst: int) -> str:
    """Return why a parameter is not identified."""
    sd = np.sqrt(np.diag(covariance))
    correlation = covariance[worst] / (sd * sd[worst])
    correlation[worst] = 0.0
    other = int(np.argmax(np.abs(correlation)))
    if abs(correlation[other]) > 0.7:
        return f"the logs determine it only together with {names[free[other]]} (correlation {correlation[other]:.2f})"
    return f"the logs leave {100.0 * min(1.0, sd[worst]):.0f} % of the prior's uncertainty"


def _resampled(
    gradients: FloatArray, matrices: FloatArray, errors: FloatArray, replicates: int, seed: int
) -> FloatArray:
    """Return the covariance of bootstrap replicates; a replicate is a single Newton step from the fit (Andrews 2002).

    A replicate draws blocks with replacement, a new centre of the prior from the prior, and the errors that all logs share.
    """
    generator = np.random.default_rng(seed)
    count, size = gradients.shape
    centred = gradients - gradients.mean(axis=0)
    draws = generator.multinomial(count, np.full(count, 1.0 / count), size=replicates).astype(np.float64)
    centres = generator.standard_normal((replicates, size))
    centres += generator.standard_normal((replicates, len(errors))) @ errors
    steps = np.empty((replicates, size))
    for k, (draw, centre) in enumerate(zip(draws, centres, strict=True)):
        H = np.einsum("b,bij->ij", draw, matrices) + np.eye(size)
        steps[k] = np.linalg.solve(H, centre - draw @ centred)
    covariance = np.cov(steps, rowvar=False, ddof=1).reshape(size, size) * count / max(1, count - 1)
    return _bounded(covariance, np.linalg.inv(matrices.sum(axis=0) + np.eye(size)))

"""Where simulated agents come from: success by a logistic model, steps gamma distributed and cut at 1000."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import expit
from scipy.stats import gamma

FloatArray = NDArray[np.float64]

FAILED = 5.0
"""logits by which a training that failed is worse: 19 % of the scenarios instead of 94 %"""
LIMIT = 1000.0
"""steps of an episode at most"""


@cache
def _hermite() -> tuple[FloatArray, FloatArray]:
    return np.polynomial.hermite_e.hermegauss(80)


@dataclass(frozen=True, slots=True)
class World:
    """The trainings of one configuration."""

    level: float
    """logit of the success rate of a middling seed on a middling scenario"""
    seed_sd: float
    """standard deviation of a training seed's logit"""
    scenario_sd: float = 1.0
    """standard deviation of a scenario's logit"""
    failing: float = 0.0
    """share of the trainings that fail: their logit is lower by `FAILED`"""

    def draw(
        self, S: int, E: int, scenarios: FloatArray, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Success (S, E) in {0, 1} and steps (S, E) of an agent on scenarios (E,) of standard normal difficulty."""
        success, steps = drawn([self], S, scenarios[None, :], rng)
        return success[0, 0], steps[0, 0]

    def truth(self) -> tuple[float, float]:
        """The rate and the mean number of steps over all seeds and scenarios there could be."""
        weights, logit = self._nodes()
        scale = 100.0 * np.exp(-0.3 * logit)
        cut = LIMIT / scale
        # E[min(G, c)] of a gamma variable of shape 2: 2 F_3(c) + c (1 - F_2(c))
        steps = scale * (2 * gamma.cdf(cut, 3) + cut * gamma.sf(cut, 2))
        return float(weights @ expit(logit)), float(weights @ steps)

    def penalised(self) -> float:
        """The true PAR-1 of the steps: a failure, independent of the steps given the logit, counts as the limit."""
        weights, logit = self._nodes()
        scale = 100.0 * np.exp(-0.3 * logit)
        cut = LIMIT / scale
        steps = scale * (2 * gamma.cdf(cut, 3) + cut * gamma.sf(cut, 2))
        return float(weights @ (expit(logit) * steps + (1 - expit(logit)) * LIMIT))

    def _nodes(self) -> tuple[FloatArray, FloatArray]:
        """Weights and logits of a quadrature over seeds and scenarios."""
        nodes, weights = _hermite()
        weights = np.outer([1 - self.failing, self.failing], weights / weights.sum()).ravel()
        nodes = np.hypot(self.seed_sd, self.scenario_sd) * nodes
        return weights, self.level + np.concatenate([nodes, nodes - FAILED])


def of_rate(rate: float, seed_sd: float, failing: float = 0.0) -> World:
    """The world of that true success rate; with `failing`, the rate is that of the trainings that do not fail."""
    level = brentq(lambda x: World(x, seed_sd).truth()[0] - rate, -40, 60)
    return World(float(level), seed_sd, failing=failing)


def drawn(
    worlds: Sequence[World], S: int, scenarios: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Success and steps (tables, agents, S, E), an agent per world; `scenarios` (tables, E) are shared by them."""
    shape = (len(scenarios), len(worlds), S)
    level, sd, failing = (np.array([getattr(w, k) for w in worlds]) for k in ("level", "seed_sd", "failing"))
    seeds = level[:, None] + sd[:, None] * rng.normal(size=shape)
    if failing.any():
        seeds -= FAILED * (rng.random(shape) < failing[:, None])
    scale = np.array([w.scenario_sd for w in worlds])[None, :, None, None]
    logit = seeds[..., None] + scale * scenarios[:, None, None, :]
    success = (rng.random(logit.shape) < expit(logit)).astype(np.float64)
    return success, np.minimum(rng.gamma(2.0, 100.0 * np.exp(-0.3 * logit)), LIMIT)


def successes(worlds: Sequence[World], S: int, scenarios: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Success alone, as `drawn` has it, in half the time."""
    shape = (len(scenarios), len(worlds), S)
    level, sd, failing = (np.array([getattr(w, k) for w in worlds]) for k in ("level", "seed_sd", "failing"))
    seeds = level[:, None] + sd[:, None] * rng.normal(size=shape)
    if failing.any():
        seeds -= FAILED * (rng.random(shape) < failing[:, None])
    logit = (seeds[..., None] + scenarios[:, None, None, :]).astype(np.float32)
    return (rng.random(logit.shape, dtype=np.float32) < expit(logit)).astype(np.float64)


def shifted(world: World, points: float) -> World:
    """The same world with a true rate that is lower by so much (0.02 is two points)."""
    wanted = world.truth()[0] - points
    level = brentq(lambda x: replace(world, level=x).truth()[0] - wanted, -40, 60)
    return replace(world, level=float(level))

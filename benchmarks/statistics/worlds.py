"""Simulate agents: success from a logistic model, steps from a gamma distribution cut at 1000."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import expit
from scipy.stats import gamma
from scipy.stats import t as student

FloatArray = NDArray[np.float64]

FAILED = 5.0
"""logits by which a failed training is worse: it succeeds in 19 % of the scenarios instead of 94 %"""
LIMIT = 1000.0
"""largest number of steps of an episode"""


@cache
def _hermite() -> tuple[FloatArray, FloatArray]:
    return np.polynomial.hermite_e.hermegauss(80)


@dataclass(frozen=True, slots=True)
class World:
    """The trainings of one configuration."""

    level: float
    """logit of the success rate of a median seed on a median scenario"""
    seed_sd: float
    """standard deviation of a training seed's logit"""
    scenario_sd: float = 1.0
    """standard deviation of a scenario's logit"""
    failing: float = 0.0
    """share of the trainings that fail: their logit is lower by `FAILED`"""
    tails: int = 0
    """degrees of freedom of the seeds' Student's t, scaled to `seed_sd`; 0: normal seeds"""

    def draw(
        self, S: int, E: int, scenarios: FloatArray, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Return success (S, E) as 0 or 1, and steps (S, E), on scenarios with difficulties (E,) from a standard normal."""
        success, steps = drawn([self], [S], scenarios[None, :], rng)
        return success[0][0], steps[0][0]

    def seeds(self, shape: tuple[int, ...], rng: np.random.Generator) -> FloatArray:
        """Return logits of training seeds."""
        z = rng.standard_t(self.tails, shape) / self._scale if self.tails else rng.normal(size=shape)
        failed = FAILED * (rng.random(shape) < self.failing) if self.failing else 0.0
        return np.asarray(self.level + self.seed_sd * z - failed)

    @property
    def _scale(self) -> float:
        """Return the standard deviation of Student's t."""
        return float(np.sqrt(self.tails / (self.tails - 2)))

    def rate(self) -> float:
        """Return the success rate over all possible seeds and scenarios."""
        weights, logit = self._nodes()
        return float(weights @ expit(logit))

    def truth(self) -> tuple[float, float]:
        """Return the rate and the mean number of steps over all possible seeds and scenarios."""
        weights, logit = self._nodes()
        return self.rate(), float(weights @ _mean_steps(logit))

    def penalised(self) -> float:
        """Return the true PAR-1 of the steps: a failure counts as the limit. Given the logit, failures and steps are independent."""
        weights, logit = self._nodes()
        return float(weights @ (expit(logit) * _mean_steps(logit) + (1 - expit(logit)) * LIMIT))

    def _nodes(self) -> tuple[FloatArray, FloatArray]:
        """Return weights and logits of a quadrature over seeds and scenarios."""
        nodes, weights = _hermite()
        weights = weights / weights.sum()
        if self.tails:
            seeds = student.ppf((np.arange(500) + 0.5) / 500, self.tails) / self._scale
            nodes = np.add.outer(self.seed_sd * seeds, self.scenario_sd * nodes).ravel()
            weights = np.tile(weights / len(seeds), len(seeds))
        else:
            nodes = np.hypot(self.seed_sd, self.scenario_sd) * nodes
        weights = np.outer([1 - self.failing, self.failing], weights).ravel()
        return weights, self.level + np.concatenate([nodes, nodes - FAILED])


def _mean_steps(logit: FloatArray) -> FloatArray:
    """Return E[min(G, c)] of a gamma variable G of shape 2 with the logit's scale: 2 F_3(c) + c (1 - F_2(c))."""
    scale = 100.0 * np.exp(-0.3 * logit)
    cut = LIMIT / scale
    return np.asarray(scale * (2 * gamma.cdf(cut, 3) + cut * gamma.sf(cut, 2)))


@cache
def of_rate(rate: float, seed_sd: float, failing: float = 0.0, tails: int = 0) -> World:
    """Return the world with this true success rate; with `failing`, with this rate of the trainings that do not fail."""
    whole = World(0.0, seed_sd, tails=tails)
    level = brentq(lambda x: replace(whole, level=x).rate() - rate, -40, 60)
    return replace(whole, level=float(level), failing=failing)


def drawn(
    worlds: Sequence[World],
    seeds: Sequence[int],
    scenarios: FloatArray,
    rng: np.random.Generator,
) -> tuple[list[FloatArray], list[FloatArray]]:
    """Return success and steps (tables, S_i, E) of one agent for each world, all on the same `scenarios` (tables, E)."""
    success, steps = [], []
    for world, S in zip(worlds, seeds, strict=True):
        logit = world.seeds((len(scenarios), S, 1), rng) + world.scenario_sd * scenarios[:, None, :]
        success.append((rng.random(logit.shape) < expit(logit)).astype(np.float64))
        steps.append(np.minimum(rng.gamma(2.0, 100.0 * np.exp(-0.3 * logit)), LIMIT))
    return success, steps


def successes(
    worlds: Sequence[World], seeds: Sequence[int], scenarios: FloatArray, rng: np.random.Generator
) -> list[FloatArray]:
    """Return the success of `drawn` without the steps, in half the time."""
    found = []
    for world, S in zip(worlds, seeds, strict=True):
        logit = world.seeds((len(scenarios), S, 1), rng) + world.scenario_sd * scenarios[:, None, :]
        logit = logit.astype(np.float32)
        found.append((rng.random(logit.shape, dtype=np.float32) < expit(logit)).astype(np.float64))
    return found


def shifted(world: World, points: float) -> World:
    """Return the same world with a lower true rate (0.02: lower by two points)."""
    wanted = world.rate() - points
    level = brentq(lambda x: replace(world, level=x).rate() - wanted, -40, 60)
    return replace(world, level=float(level))

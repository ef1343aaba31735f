"""Simulate tables of learners and a controller whose typical trainings have known rates, PAR-1 steps or RMS errors."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.optimize import brentq
from scipy.special import expit

FloatArray = NDArray[np.float64]

EPISODES = 500
LIMIT = 1000.0
"""largest number of steps of an episode"""
FAILED = 5.0
"""logits by which a failing training is worse than the others"""
LOST = 0.9
"""share of episodes that a failing training fails, for PAR-1 steps"""
WORSE = 10.0
"""factor on the RMS error of a failing training"""
_GRID = 20_001
"""quantiles of a distribution of trainings; the typical training is the median"""


@dataclass(frozen=True, slots=True)
class Design:
    """Equal learners, and the controller that they are compared with."""

    kind: str
    """kind of the values: rate, par or rms"""
    sd: float
    """standard deviation of trainings, in logits, or in logarithms of steps and errors"""
    value: float = 0.9
    """rate of the typical training; other kinds have their own scale"""
    shape: str = "normal"
    """distribution of trainings: normal; skew and skewup: exponential towards the worse or the better side; heavy: Student's t(3)"""
    rho: float = 1.0
    """correlation of the scenarios' difficulty for learners and for the controller"""
    failing: float = 0.0
    """share of failing trainings"""
    inter: float = 0.0
    """standard deviation of the residual of a training and a scenario, in logarithms"""
    lost: float = 0.01
    """share of failed episodes of the trainings that do not fail, for PAR-1 steps"""
    controller: float | None = None
    """value of the controller: a rate, or a factor on the typical training's steps or errors; None: the typical training's value"""

    @property
    def rate(self) -> bool:
        """Return whether the values are 0 and 1."""
        return self.kind == "rate"

    @property
    def name(self) -> str:
        """Return the design in words, for a row of a table."""
        what = {"rate": f"rate {100 * self.value:g} %", "par": "PAR-1", "rms": "RMS"}[self.kind]
        parts = [what, f"sd {self.sd:g}"]
        parts += [self.shape] if self.shape != "normal" else []
        parts += [f"rho {self.rho:g}"] if self.rho != 1 else []
        parts += [f"{100 * self.failing:g} % fail"] if self.failing else []
        parts += [f"own luck {self.inter:g}"] if self.inter else []
        if self.controller is not None:
            other = f"{100 * self.controller:g} %" if self.rate else f"× {self.controller:g}"
            parts.append(f"controller {other}")
        return ", ".join(parts)

    def tables(
        self, tables: int, learners: int, trainings: int, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Return values of learners (tables, learners, trainings, E) and of the controller (tables, 1, 1, E)."""
        hard = rng.normal(size=(tables, EPISODES))
        own = self.rho * hard + np.sqrt(1 - self.rho**2) * rng.normal(size=hard.shape)
        still = np.zeros((tables, 1, 1))
        controller = self._values(*self._of_controller(), still, still > 0, own, rng)
        return self.learners(learners, trainings, hard, rng), controller

    def learners(
        self, learners: int, trainings: int, hard: FloatArray, rng: np.random.Generator
    ) -> FloatArray:
        """Return values (tables, learners, trainings, E) for scenarios with these difficulties (tables, E)."""
        shape = (len(hard), learners, trainings)
        failing = rng.random(shape) < self.failing
        badness = self.sd * _standard(self.shape, shape, rng)
        if self.kind != "par":
            badness += _FAILS[self.kind] * failing
        badness -= _typical(self.kind, self.shape, self.sd, self.failing)
        return self._values(self.value, 1.0, badness, failing, hard, rng)

    def _of_controller(self) -> tuple[float, float]:
        """Return the controller's rate, and the factor on its steps and errors."""
        if self.controller is None:
            return self.value, 1.0
        return (self.controller, 1.0) if self.rate else (self.value, self.controller)

    def _values(
        self,
        value: float,
        scale: float,
        badness: FloatArray,
        failing: NDArray[np.bool_],
        hard: FloatArray,
        rng: np.random.Generator,
    ) -> FloatArray:
        """Return values (..., E) of trainings (...) that are worse than the typical one by `badness`."""
        shape = (*badness.shape, EPISODES)
        noise = rng.standard_normal(shape, dtype=np.float32)
        badness, hard = badness[..., None], hard[:, None, None]
        if self.rate:
            chance = expit((level(value) - badness - hard).astype(np.float32))
            return np.asarray(rng.random(shape, dtype=np.float32) < chance, dtype=np.float64)
        width = float(np.hypot(0.1, self.inter))
        factor = np.exp(badness + 0.3 * hard + width * noise)
        if self.kind == "rms":
            return np.asarray(0.1 * scale * factor, dtype=np.float64)
        lost = rng.random(shape, dtype=np.float32) < np.where(failing, LOST, self.lost)[..., None]
        return np.asarray(np.where(lost, LIMIT, np.minimum(200.0 * scale * factor, LIMIT)))


_FAILS = {"rate": FAILED, "rms": float(np.log(WORSE)), "par": 100.0}
"""how much worse a failing training is; for PAR-1 steps, worse than all others"""


def _standard(shape: str, size: tuple[int, ...], rng: np.random.Generator) -> FloatArray:
    """Return how much worse trainings are than the mean, with standard deviation 1."""
    if shape == "normal":
        return rng.normal(size=size)
    if shape == "heavy":
        return np.asarray(rng.standard_t(3, size) / np.sqrt(3))
    exponential = rng.exponential(size=size) - 1
    return exponential if shape == "skew" else -exponential


@cache
def _typical(kind: str, shape: str, sd: float, failing: float) -> float:
    """Return how much worse the typical training is than a training at 0; failing trainings count."""
    q = (np.arange(_GRID) + 0.5) / _GRID
    quantiles = {
        "normal": stats.norm.ppf(q),
        "heavy": stats.t.ppf(q, 3) / np.sqrt(3),
        "skew": -np.log1p(-q) - 1,
        "skewup": 1 + np.log(q),
    }
    z = quantiles[shape]
    values = np.concatenate([sd * z, sd * z + _FAILS[kind]])
    weights = np.repeat([1 - failing, failing], _GRID) / _GRID
    order = np.argsort(values)
    return float(values[order][np.searchsorted(np.cumsum(weights[order]), 0.5)])


@cache
def level(rate: float) -> float:
    """Return the logit of a policy with this rate over scenarios of standard deviation 1."""
    if rate >= 1:
        return 100.0
    nodes, weights = np.polynomial.hermite_e.hermegauss(80)
    weights = weights / weights.sum()
    return float(brentq(lambda x: float(weights @ expit(x + nodes)) - rate, -40, 40))

"""How often the intervals of interquartile means over conditions and vehicles hold the truth."""

from __future__ import annotations

import numpy as np
from scipy.special import expit

from auvbench.analysis.score import interquartile, stratified
from benchmarks.statistics.worlds import FloatArray

LEVELS = (0.4, 2.9)
"""logits of the easiest and the hardest condition"""
LUCK, REST = 1.0, 0.3
"""logits by which trainings differ, under all conditions alike and under each"""
EPISODES = 200
MANY = 200_000
"""trainings that stand for all there could be"""

DESIGNS = {
    "1 vehicle, 12 conditions": (1, 12),
    "3 vehicles, 1 condition": (3, 1),
    "3 vehicles, 4 conditions": (3, 4),
}


def draw(vehicles: int, conditions: int, S: int, rng: np.random.Generator) -> list[FloatArray]:
    """Success rates (S, conditions) of trainings on each vehicle, tested on `EPISODES` episodes each."""
    levels = np.linspace(*LEVELS, vehicles * conditions).reshape(vehicles, conditions)
    found = []
    for level in levels:
        logit = level + LUCK * rng.normal(size=(S, 1)) + REST * rng.normal(size=(S, conditions))
        found.append(rng.binomial(EPISODES, expit(logit)) / EPISODES)
    return found


def coverage(vehicles: int, conditions: int, S: int, replications: int, seed: int = 0) -> float:
    """Return the share of the intervals of interquartile means that hold the truth."""
    rng = np.random.default_rng(seed)
    many = draw(vehicles, conditions, MANY // (vehicles * conditions), rng)
    truth = float(interquartile(np.concatenate([x.ravel() for x in many])))
    held = 0
    for _ in range(replications):
        e = stratified(draw(vehicles, conditions, S, rng), interquartile, resamples=300, rng=rng)
        held += e.low <= truth <= e.high
    return held / replications

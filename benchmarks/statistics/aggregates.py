"""How often the intervals of aggregates over conditions and vehicles hold the truth."""

from __future__ import annotations

import numpy as np
from scipy.special import expit

from auvbench.statistics.aggregate import Aggregate, interquartile, optimality_gap, stratified
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
AGGREGATES: dict[str, Aggregate] = {"IQM": interquartile, "optimality gap": optimality_gap}


def draw(vehicles: int, conditions: int, S: int, rng: np.random.Generator) -> list[FloatArray]:
    """Success rates (S, conditions) of trainings on each vehicle, tested on `EPISODES` episodes each."""
    levels = np.linspace(*LEVELS, vehicles * conditions).reshape(vehicles, conditions)
    found = []
    for level in levels:
        logit = level + LUCK * rng.normal(size=(S, 1)) + REST * rng.normal(size=(S, conditions))
        found.append(rng.binomial(EPISODES, expit(logit)) / EPISODES)
    return found


def coverage(
    vehicles: int, conditions: int, S: int, replications: int, seed: int = 0
) -> dict[str, tuple[float, float]]:
    """By aggregate the share of intervals that hold the truth: seeds drawn with all their scores, and score by score."""
    rng = np.random.default_rng(seed)
    many = draw(vehicles, conditions, MANY // (vehicles * conditions), rng)
    truth = {
        name: float(aggregate(np.concatenate([x.ravel() for x in many])))
        for name, aggregate in AGGREGATES.items()
    }
    held = {name: np.zeros(2) for name in AGGREGATES}
    for _ in range(replications):
        strata = draw(vehicles, conditions, S, rng)
        apart = [column[:, None] for scores in strata for column in scores.T]
        for name, aggregate in AGGREGATES.items():
            for i, parts in enumerate((strata, apart)):
                e = stratified(parts, aggregate, resamples=300, rng=rng)
                held[name][i] += e.low <= truth[name] <= e.high
    return {name: (float(x[0]) / replications, float(x[1]) / replications) for name, x in held.items()}

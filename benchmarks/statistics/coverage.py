"""Measure how often intervals of means contain the true value: the tables' t-type interval and two bootstraps."""

from __future__ import annotations

import numpy as np

from auvbench.statistics.crossed import crossed, means
from benchmarks.statistics.worlds import FloatArray, World, drawn, of_rate

BATCH = 100
"""experiments at once"""

WORLDS = (
    ("0.5", of_rate(0.6, 0.5)),
    *((f"{sd:g}", of_rate(0.93, sd)) for sd in (0.5, 1.0, 2.0)),
    *((f"{sd:g}", of_rate(0.98, sd)) for sd in (1.0, 2.0)),
    ("0.5, 3 of 10 fail", World(3.25, 0.5, failing=0.3)),
)
"""simulated trainings; the last vary as much as trainings of reinforcement learning can"""


def coverage(
    world: World, S: int, E: int, *, replications: int, confidence: float = 0.95, seed: int = 0
) -> FloatArray:
    """Return the share (2,) of experiments whose intervals of the success rate and of the mean steps contain the true value."""
    rng = np.random.default_rng(seed)
    inside, truth = np.zeros(2), world.truth()
    for start in range(0, replications, BATCH):
        scenarios = rng.normal(size=(min(BATCH, replications - start), E))
        for metric, (values,) in enumerate(drawn([world], [S], scenarios, rng)):
            found = means(crossed(list(values), rate=metric == 0, paired=False), confidence)
            inside[metric] += sum(one.low <= truth[metric] <= one.high for one in found)
    return inside / replications


def of_bootstraps(
    world: World, S: int, E: int, *, replications: int, resamples: int = 300, seed: int = 0
) -> dict[str, float]:
    """Return for each method the share of experiments whose 95 % interval of the rate contains the true value."""
    rng = np.random.default_rng(seed)
    truth = world.rate()
    inside = dict.fromkeys(("bootstrap", "rescaled"), 0)
    for _ in range(replications):
        data = world.draw(S, E, rng.normal(size=E), rng)[0]
        by_seed = rng.multinomial(E, np.full(E, 1 / E), size=resamples) @ data.T / E
        for name in inside:
            # Draws S - 1 of S seeds, so that the variance is unbiased (Rao & Wu 1988, JASA 83:231).
            draws = max(S - 1, 1) if name == "rescaled" else S
            seeds = rng.multinomial(draws, np.full(S, 1 / S), size=resamples) / draws
            low, high = np.quantile((by_seed * seeds).sum(axis=1), [0.025, 0.975])
            inside[name] += int(low <= truth <= high)
    return {name: count / replications for name, count in inside.items()}

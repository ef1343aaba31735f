"""Measure how often adding seeds until a difference is resolved finds a false difference."""

from __future__ import annotations

import numpy as np

from auvbench.statistics.typical import ALPHA
from benchmarks.statistics.designs import level
from benchmarks.statistics.letters import BATCH, resolved
from benchmarks.statistics.worlds import World, successes

LOOKS = {
    "5, 6, 7, ... 20 seeds": tuple(range(5, 21)),
    "5, 8, 11, 14, 17, 20": (5, 8, 11, 14, 17, 20),
    "10, 15, 20": (10, 15, 20),
    "20": (20,),
}


def found(replications: int, seed: int = 0, E: int = 500) -> dict[str, float]:
    """Return for each series of looks the share of experiments that find a learner different from an equal controller.

    The rate of each is 90 %; the standard deviation of trainings is 0.5 logits. A look keeps the seeds of earlier looks.
    """
    rng = np.random.default_rng(seed)
    learner, controller = World(level(0.9), 0.5), World(level(0.9), 0.0)
    counts = dict.fromkeys(LOOKS, 0)
    first, most = LOOKS["5, 6, 7, ... 20 seeds"], 20
    for start in range(0, replications, BATCH):
        scenarios = rng.normal(size=(min(BATCH, replications - start), E))
        x, y = successes([learner, controller], [most, 1], scenarios, rng)
        seen = {S: resolved(x[:, :S], y, ALPHA) for S in first}
        for name, looks in LOOKS.items():
            counts[name] += int(np.any([seen[S] for S in looks], axis=0).sum())
    return {name: count / replications for name, count in counts.items()}

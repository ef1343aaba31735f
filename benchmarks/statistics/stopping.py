"""Who adds seeds and looks again until a difference is resolved: how often where there is none."""

from __future__ import annotations

import numpy as np

from auvbench.statistics.differences import resolution
from benchmarks.statistics.letters import ALPHA, BATCH
from benchmarks.statistics.tables import crossed
from benchmarks.statistics.worlds import of_rate, successes

LOOKS = {
    "3, 4, 5, ... 15 seeds": tuple(range(3, 16)),
    "3, 6, 9, 12, 15": (3, 6, 9, 12, 15),
    "5, 10, 15": (5, 10, 15),
    "15": (15,),
}


def found(replications: int, seed: int = 0, E: int = 500) -> dict[str, float]:
    """By design of the looks, the share of experiments with two equal agents that find a difference at some look.

    Both of 90 %, trainings 0.5 logits apart. The first seeds of an experiment are those of its earlier looks.
    """
    rng = np.random.default_rng(seed)
    world = of_rate(0.9, 0.5)
    counts = dict.fromkeys(LOOKS, 0)
    for start in range(0, replications, BATCH):
        scenarios = rng.normal(size=(min(BATCH, replications - start), E))
        data = successes([world] * 2, [max(map(max, LOOKS.values()))] * 2, scenarios, rng)
        p = {
            S: resolution(crossed([x[:, :S] for x in data], rate=True))[:, 0, 1]
            for S in LOOKS["3, 4, 5, ... 15 seeds"]
        }
        for name, looks in LOOKS.items():
            counts[name] += int((np.array([p[S] for S in looks]).min(axis=0) < ALPHA).sum())
    return {name: count / replications for name, count in counts.items()}

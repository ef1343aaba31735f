"""Measure the power of the trainings that `auvbench plan` names, on trainings from another model."""

from __future__ import annotations

import numpy as np

from auvbench.analysis.planning import needs
from auvbench.statistics.power import Rates
from auvbench.statistics.typical import ALPHA, Sample, difference, sample
from benchmarks.statistics.designs import EPISODES, Design

TARGETS = (0.8, 0.95)
AGENTS = 6
LOW, HIGH = 0.9, 0.95
SDS = (0.3, 0.5)
SLACK = 5.0
"""percentage points by which the plan's simulation of 200 comparisons may be off: two standard errors at 80 %"""


def planned(sd: float) -> dict[tuple[int, float], int | None]:
    """Return the trainings that a plan names for 90 against 95 %, by rows of the table and power."""
    need = needs(Rates(sd), (LOW, HIGH), EPISODES, agents=AGENTS, targets=TARGETS)
    return {(1, t): need.alone[t] for t in TARGETS} | {(AGENTS - 1, t): need.among[t] for t in TARGETS}


def power(sd: float, trainings: int, rows: int, replications: int, shape: str = "normal") -> float:
    """Return the share of comparisons with a controller that find the difference (%), the lower of the two directions."""
    found = []
    for learner, controller in ((HIGH, LOW), (LOW, HIGH)):
        design = Design("rate", sd, learner, shape=shape, controller=controller)
        rng = np.random.default_rng([trainings, rows])
        right = 0
        for _ in range(0, replications, 20):
            x, y = design.tables(20, 1, trainings, rng)
            low, high = difference(sample(x), Sample(y.mean(axis=-1), y[:, :, 0]), True).ends(ALPHA / rows)
            right += int((low > 0).sum() if learner > controller else (high < 0).sum())
        found.append(100 * right / (20 * len(range(0, replications, 20))))
    return min(found)

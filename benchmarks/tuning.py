"""What a study's controller costs: sampling, deciding, journal and listing, over simulated trials."""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from auvbench.commands.tune import plan_of, split
from auvbench.config.compose import compose
from auvbench.tuning.journal import Journal
from auvbench.tuning.search import Search

TRIALS = 1000
PACE = 30_000.0
"""steps per second of one core with PPO's preset (docs/performance.md), against which the controller is held"""


def study() -> Iterator[tuple[str, str, str, str]]:
    """A study of PPO with a thousand trials whose trainings take no time."""
    words, ranges, fixed = split(["algo=ppo", f"tune.trials={TRIALS}"])
    plan, _ = plan_of(compose("tune", words), ranges, fixed)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "journal.log")
        begun, cpu = time.perf_counter(), time.process_time()
        search = Search(plan, Journal(path, plan.dimensions, plan.budgets))
        while (step := search.next()) is not None:
            params = search.journal.params[step.trial]
            worth = -abs(math.log(float(params["algo.learning_rate"]) / 1e-3)) + 0.1 * step.rung
            result = {
                "score": worth,
                "objective": worth,
                "low": worth,
                "high": worth,
                "then": 0.0,
                "runs": ["a"],
            }
            search.report(step.trial, result)
            search.counts(), search.best, search.steps_expected()
        search.journal.close()
        wall, cpu = time.perf_counter() - begun, time.process_time() - cpu
        begun = time.perf_counter()
        Journal(path, plan.dimensions, plan.budgets, write=False)
        opened = time.perf_counter() - begun
    trained = search.steps_done() / PACE
    yield (
        f"auvbench tune, controller, {TRIALS} trials",
        f"{100 * cpu / trained:.1f}",
        "% of training",
        f"{cpu:.0f} s of processor time ({wall:.0f} s passed) beside {trained:,.0f} s of training at {PACE:,.0f} steps/s",
    )
    yield (
        f"opening a journal of {TRIALS} trials",
        f"{opened:.2f}",
        "s",
        "as the same command typed again does",
    )

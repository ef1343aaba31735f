"""Measure the overhead of a tuning study, with simulated trials: proposals, decisions and the journal."""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from omegaconf import OmegaConf

from auvbench.commands.tune import plan_of, split
from auvbench.config.compose import compose, typed
from auvbench.tuning.search import Score, Search, open_study

TRIALS = 1000
PACE = 30_000.0
"""steps per second of PPO's preset on one core (docs/performance.md)"""


def study() -> Iterator[tuple[str, str, str, str]]:
    """Measure a study of PPO with a thousand trials whose trainings take no time."""
    words, ranges, fixed = split(["algo=ppo", f"tune.trials={TRIALS}"])
    plan, _ = plan_of(compose("tune", words), ranges, fixed)
    base = typed(OmegaConf.create({**plan.base, "name": "a", "output": "b", "seed": 0}))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "journal.log")
        begun, cpu = time.perf_counter(), time.process_time()
        search = Search(plan, open_study(plan, path), base)
        while (step := search.next()) is not None:
            rate = float(search.trials[step.trial].params["algo.learning_rate"])
            worth = -abs(math.log(rate / 1e-3)) + 0.1 * step.rung
            search.report(step, Score(worth, worth, worth, worth, 0.0))
        wall, cpu = time.perf_counter() - begun, time.process_time() - cpu
        begun = time.perf_counter()
        open_study(plan, path)
        opened = time.perf_counter() - begun
        trained = sum(trial.last_step or 0 for trial in search.trials) / PACE
    yield (
        f"auvbench tune, controller, {TRIALS} trials",
        f"{100 * cpu / trained:.1f}",
        "% of training",
        f"{cpu:.0f} s of processor time ({wall:.0f} s passed) for {trained:,.0f} s of training at {PACE:,.0f} steps/s",
    )
    yield (
        f"opening a journal of {TRIALS} trials",
        f"{opened:.2f}",
        "s",
        "when the same command is typed again",
    )

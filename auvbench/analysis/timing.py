"""What the agents of a table were given of time and of training, where it is not the same for all."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

from auvbench.analysis.effects import learns
from auvbench.analysis.records import Agent, RunRecord


def limit_s(run: RunRecord) -> float:
    """S that a training episode may last; NaN where the configuration does not say."""
    if (limit := run.config.get("task.time_limit")) is not None:
        return float(limit)
    steps, f = run.config.get("task.max_steps"), run.config.get("step.frequency")
    return float(steps) / float(f) if steps and f else math.nan


def by_frequency(runs: Sequence[RunRecord], of: Callable[[RunRecord], float]) -> dict[float, list[float]]:
    """Which times `of` gives, to three digits, by the frequency of the training; of those whose frequency is known."""
    found: dict[float, set[float]] = {}
    for run in runs:
        f = run.config.get("step.frequency")
        if f is not None:
            times = found.setdefault(float(f), set())
            if not math.isnan(x := of(run)):
                times.add(float(f"{x:.3g}"))
    return {f: sorted(found[f]) for f in sorted(found)}


def differs(times: Mapping[float, Sequence[float]]) -> bool:
    """Whether times `by_frequency` change with it."""
    return len({tuple(values) for values in times.values() if values}) > 1


def budget_of(run: RunRecord) -> int:
    """Return the environment steps that a training was given; 0 where they are unknown.

    Not those that were taken: PPO finishes the rollout in which its budget ends.
    """
    given = run.config.get("train.total_steps") or run.manifest.get("total_steps")
    return int(given or run.manifest.get("steps") or 0)


def budgets_of(agent: Agent) -> tuple[int, ...]:
    """Return the budgets of an agent's trainings in environment steps, each once; empty for a controller."""
    return tuple(sorted({budget_of(run) for run in agent.runs})) if learns(agent) else ()

"""What the agents of a table were given of time and of training, where it is not the same for all."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from auvbench.analysis.effects import learns
from auvbench.analysis.formatting import listed
from auvbench.analysis.records import Agent, Finding, RunRecord


def limit_s(run: RunRecord) -> float:
    """S that a training episode may last; NaN where the configuration does not say."""
    if (limit := run.config.get("task.time_limit")) is not None:
        return float(limit)
    steps, f = run.config.get("task.max_steps"), run.config.get("step.frequency")
    return float(steps) / float(f) if steps and f else math.nan


def step_limit(run: RunRecord) -> float:
    """Steps that a training episode may last; 1000 where the configuration does not say."""
    limit, f = run.config.get("task.time_limit"), run.config.get("step.frequency")
    if limit is not None and f:
        return float(round(float(limit) * float(f)))
    return float(run.config.get("task.max_steps") or 1000)


def horizon_s(run: RunRecord) -> float:
    """S ahead of which a reward weighs 1/e in training; NaN where the configuration does not say."""
    if (horizon := run.config.get("algo.horizon_s")) is not None:
        return float(horizon)
    gamma, f = run.config.get("algo.gamma"), run.config.get("step.frequency")
    if not gamma or not f or not 0 < float(gamma) < 1:
        return math.nan
    return -1.0 / (float(f) * math.log(float(gamma)))


def in_seconds(config: Mapping[str, Any]) -> tuple[str, str]:
    """Time limit and horizon of a training in seconds, to three digits: what two ways to write the same share."""
    run = RunRecord("", Path(), "", 0, config, {})
    return f"{limit_s(run):.3g}", f"{horizon_s(run):.3g}"


def confounded(agents: Sequence[Agent]) -> Finding | None:
    """Return a finding where trainings at several frequencies also had different times; None where not."""
    runs = [run for agent in agents if learns(agent) for run in agent.runs]
    kinds = ("episodes", "discount horizons")
    times = [by_frequency(runs, of) for of in (limit_s, horizon_s)]
    differ = [kind for kind, found in zip(kinds, times, strict=True) if differs(found)]
    if not differ:
        return None
    text = (
        f"Training frequencies also differ in the seconds of their {listed(differ)}: an effect of the frequency may be "
        "one of time. experiment=frequency_time separates them."
    )
    return Finding("frequency_confounded", text)


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

"""What the agents of a table were given of time and of training, where it is not the same for all."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from auvbench.analysis.effects import learns, mean_difference
from auvbench.analysis.formatting import difference, listed, name
from auvbench.analysis.measures import Measure
from auvbench.analysis.model import Agent, Finding, RunRecord

OF_TIME = ("step.frequency", "task.time_limit", "algo.horizon_s", "task.max_steps", "algo.gamma")
"""keys of a grouping that set how long an episode and how far a discount is, beside the frequency itself"""
MOST_BUDGETS = 4
"""budgets that a sentence lists; of more, the largest and the smallest"""


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


def separated(agents: Sequence[Agent], m: Measure, confidence: float) -> Finding | None:
    """What a frequency changes where time is equal in seconds, beside what it changes where it is counted in steps.

    None where the agents do not hold both: at two frequencies trainings that are equal in seconds and trainings that
    are equal in steps, and in everything else. Lowest against highest frequency.
    """
    trained = [
        a for a in agents if learns(a) and len(a.outcome) > 1 and a.key.get("step.frequency") is not None
    ]
    frequencies = sorted({float(a.key["step.frequency"]) for a in trained})
    if len(frequencies) < 2:
        return None
    low, high = frequencies[0], frequencies[-1]
    told, ids = [], []
    for words, meaning in (("equal in seconds", in_seconds), ("counted in steps", _in_steps)):
        cells: dict[tuple[object, ...], dict[float, Agent]] = {}
        for agent in trained:
            rest = tuple(sorted((k, str(v)) for k, v in agent.key.items() if k not in OF_TIME))
            cells.setdefault((rest, meaning(agent.runs[0].config)), {})[
                float(agent.key["step.frequency"])
            ] = agent
        # Of two ways to write one cell (at 10 Hz the thesis's 1000 steps are 100 s) either serves.
        found = [(cell[high], cell[low]) for cell in cells.values() if low in cell and high in cell]
        if not found:
            return None
        change, _ = mean_difference(found, m, confidence)
        told.append(f"{difference(change, m)} with time {words}")
        ids += [run.id for pair in found for agent in pair for run in agent.runs]
    text = f"From {low:g} to {high:g} Hz {name(m)} changes by {told[0]}, by {told[1]}."
    statistic = (
        "Time limit and horizon of the training; averaged over matched cells, each interval by itself. The second is what "
        "the frequency and the time that comes with it do together; the first is what is left where the time is the same."
    )
    return Finding(text, statistic=statistic, run_ids=tuple(dict.fromkeys(ids)))


def _in_steps(config: Mapping[str, Any]) -> tuple[str, str]:
    """Step limit and discount per step."""
    run = RunRecord("", Path(), "", 0, config, {})
    f = float(config.get("step.frequency") or math.nan)
    return f"{step_limit(run):.3g}", f"{horizon_s(run) * f:.3g}"


def confounded(agents: Sequence[Agent]) -> Finding | None:
    """A finding where agents trained at several frequencies also had different times; None where not."""
    runs = [run for agent in agents if learns(agent) for run in agent.runs]
    kinds = ("the time for an episode", "the discount's horizon in seconds")
    times = {kind: by_frequency(runs, of) for kind, of in zip(kinds, (limit_s, horizon_s), strict=True)}
    differ = [kind for kind, found in times.items() if differs(found)]
    if not differ:
        return None
    limits, horizons = times.values()
    cells = [
        f"at {f:g} Hz {_several(limits[f])} for an episode and a discount that looks {_several(horizons[f])} ahead"
        for f in limits
    ]
    text = (
        f"Frequency and time are confounded: with the frequency of training {listed(differ)} "
        f"{'changes' if len(differ) == 1 else 'change'} too. What is said of a frequency here may be said of the time."
    )
    statistic = (
        f"{'; '.join(cells)}. task.time_limit and algo.horizon_s set both in seconds; experiment=frequency_time "
        "separates them."
    )
    return Finding(text, statistic=statistic[0].upper() + statistic[1:])


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


def _several(values: Sequence[float]) -> str:
    return listed([f"{v:g} s" for v in values], word="or") if values else "an unknown time"


def budget_of(run: RunRecord) -> int:
    """Environment steps that a training was given, 0 where nobody says.

    Not those that were taken: PPO finishes the rollout in which its budget ends.
    """
    given = run.config.get("train.total_steps") or run.manifest.get("total_steps")
    return int(given or run.manifest.get("steps") or 0)


def unequal_budgets(agents: Sequence[Agent]) -> str:
    """A sentence where the learning agents of a table were trained for different numbers of steps; '' where not."""
    budgets: dict[int, list[str]] = {}
    for agent in agents:
        if learns(agent):
            for steps in {budget_of(run) for run in agent.runs}:
                budgets.setdefault(steps, []).append(agent.label)
    if len(budgets) < 2:
        return ""
    order = sorted(budgets.items(), reverse=True)
    parts = [f"{listed(labels, 4)} {steps:,}" for steps, labels in order]
    if len(parts) > MOST_BUDGETS:
        parts = [f"from {parts[0]} to {parts[-1]}, {len(parts) - 2} others between"]
    return f"Unequal budgets of training, in environment steps: {'; '.join(parts)}. Who had more may be ahead for that alone."

"""Computing cost: the time of an action and of a training, and solves that failed or were late."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from auvbench.analysis.effects import learns
from auvbench.analysis.evaluations import LARGEST
from auvbench.analysis.formatting import listed
from auvbench.analysis.records import Agent, RunRecord
from auvbench.statistics.estimate import Estimate


def action_time(agent: Agent, protocol: str, which: str) -> Estimate | None:
    """The ms that an action took, the mean over the agent's runs; None where a test does not say.

    Args:
        agent: whose runs were tested.
        protocol: by which.
        which: median_ms or p95_ms.
    """
    return _mean([_timed(run, protocol).get(which) for run in agent.runs if protocol in run.evaluations])


def training_time(agent: Agent) -> Estimate | None:
    """Seconds of processor cores that a training took, the mean over the agent's runs; None where a manifest does not say."""
    return _mean([run.manifest.get("cpu_time_s") or None for run in agent.runs])  # 0.0: nothing was trained


def machines(agents: Sequence[Agent], protocol: str, columns: Sequence[str]) -> tuple[str, ...]:
    """Sentences on the columns of times, where these were taken on processors of several kinds."""
    taken: dict[str, dict[str, list[Any]]] = {}
    if any(name.startswith("action_") for name in columns):
        taken["an action"] = {a.label: [_timed(run, protocol) for run in a.runs] for a in agents}
    if "training_cpu_s" in columns:
        learners = [a for a in agents if learns(a)]
        taken["a training"] = {a.label: [run.manifest.get("host") for run in a.runs] for a in learners}
    return tuple(text for what, places in taken.items() if (text := _several(what, places)))


def _several(what: str, places: Mapping[str, Sequence[Any]]) -> str:
    """Which agents' times are of which processor, the one of most agents without their names; '' where all are of one.

    Args:
        what: took the time.
        places: by an agent's label what its files say of the machines, `cpu` among it.
    """
    holders: dict[str, list[str]] = {}
    for label, found in places.items():
        named = [place.get("cpu") for place in found if isinstance(place, Mapping)]
        for cpu in dict.fromkeys(cpu for cpu in named if isinstance(cpu, str)):
            holders.setdefault(cpu, []).append(label)
    if len(holders) < 2:
        return ""
    (most, _), *others = sorted(holders.items(), key=lambda item: (-len(item[1]), item[0]))
    parts = "; ".join(f"{cpu} ({listed(labels, 6)})" for cpu, labels in others)
    return f"Times of {what} are of {most} but for {parts}: of different processors they do not compare."


def _mean(found: Sequence[Any]) -> Estimate | None:
    """The mean of times that files state; None where one of them states none, or no time."""
    numbers = [float(v) for v in found if isinstance(v, int | float) and not isinstance(v, bool)]
    if not numbers or len(numbers) < len(found) or not all(0 <= v <= LARGEST for v in numbers):
        return None
    return Estimate(float(np.mean(numbers)), np.nan, np.nan, 0.95)


def _timed(run: RunRecord, protocol: str) -> Mapping[str, Any]:
    evaluation = run.evaluations.get(protocol)
    found = evaluation.summary.get("inference") if evaluation is not None else None
    return found if isinstance(found, Mapping) else {}

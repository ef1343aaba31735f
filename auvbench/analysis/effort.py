"""Report what each agent knows beyond noisy readings, and how many trials chose its settings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from auvbench.analysis.records import Agent, Ranking, RunRecord, run_learns
from auvbench.registry import AGENTS, BLOCKS
from auvbench.untrusted.text import short

VELOCITIES = ("velocity", "angular_velocity", "velocity_error")
"""observation blocks that are true velocities"""


def with_effort(ranking: Ranking, agents: Sequence[Agent], trials: Mapping[str, int]) -> Ranking:
    """Return the ranking with each agent's knowledge, its number of tuning trials and the cost of these trials.

    Args:
        ranking: ranking of the agents.
        agents: agents with their runs.
        trials: number of tuning trials by the agent's label; replaces the number recorded in the agent's runs.
    """
    rows = []
    for row, agent in zip(ranking.rows, ranking.ordered(agents), strict=True):
        run = agent.runs[0]
        knows = knowledge(run)
        if _estimates(run, ranking.protocol, ranking.condition):
            knows = tuple(source for source in knows if source != "true velocities")
        count, steps, seconds = (_most(agent, key) for key in ("trials", "steps", "cpu_s"))
        count = trials.get(row.label) or count
        rows.append(replace(row, knows=knows, trials=count, trial_steps=steps, trial_s=seconds))
    return replace(ranking, rows=tuple(rows))


def _most(agent: Agent, key: str) -> Any:
    """Return the largest value of `algo.tuned.<key>`, a cost of tuning, in the agent's runs; None if no run has the key."""
    values = [run.config.get(f"algo.tuned.{key}") for run in agent.runs]
    return max((value for value in values if isinstance(value, int | float)), default=None)


def knowledge(run: RunRecord) -> tuple[str, ...]:
    """Return what a run's agent knows beyond noisy positions: sheet, model, preview, map, true velocities."""
    config = run.config
    spec = AGENTS.get(str(config.get("algo.agent")))
    sources = dict.fromkeys(() if spec is None else spec.knows)
    observed = _blocks(config)
    reads = spec is None or spec.observes
    plans = run_learns(run) or "model" in sources  # controllers without a model do not use the preview
    if plans and "preview" in observed and config.get("task.preview.points"):
        sources["preview"] = None
    if reads and "way" in observed:
        sources["map"] = None
    if reads and any(block in observed for block in VELOCITIES):
        sources["true velocities"] = None
    if reads:  # list the observation blocks of other packages by name
        sources |= dict.fromkeys(short(str(block), 40) for block in observed if block not in BLOCKS.own)
    return tuple(sources)


def _estimates(run: RunRecord, protocol: str, condition: str) -> bool:
    """Return whether the agent observed estimates of its state in a test. If so, the summary has a navigation error."""
    conditions = run.evaluations[protocol].summary["conditions"] if protocol in run.evaluations else ()
    return any(
        entry["name"] == condition and entry.get("mean_navigation_error_rms_m") is not None
        for entry in conditions
    )


def _blocks(config: Mapping[str, Any]) -> Sequence[Any]:
    blocks = config.get("task.observation")
    return blocks if isinstance(blocks, list | tuple) else ()

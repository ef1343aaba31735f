"""Effects of a factor of the grid, averaged over the cells that match in everything else."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from auvbench.analysis.labels import part, sort_key
from auvbench.analysis.measures import Measure
from auvbench.analysis.records import Agent, RunRecord
from auvbench.config.agents import learns as is_learner
from auvbench.statistics import contrast, resolution
from auvbench.statistics.intervals import Estimate


def learns(agent: Agent) -> bool:
    """Whether the agent was trained: K and the training frequency mean nothing to one that was not."""
    return any(run_learns(run) for run in agent.runs)


def run_learns(run: RunRecord) -> bool:
    """Whether the run is a training, one that failed at its first step included."""
    return bool(run.manifest.get("steps")) or is_learner(
        {key: run.config.get(f"algo.{key}") for key in ("agent", "learns")}
    )


def budget_of(run: RunRecord) -> int:
    """Return the environment steps that a training was given; 0 where they are unknown.

    Not those that were taken: PPO finishes the rollout in which its budget ends.
    """
    given = run.config.get("train.total_steps") or run.manifest.get("total_steps")
    return int(given or run.manifest.get("steps") or 0)


@dataclass(frozen=True, slots=True)
class Effect:
    """Difference first level - second level of a factor, averaged over matched cells."""

    factor: str
    first: str
    second: str
    pairs: tuple[tuple[Agent, Agent], ...]
    difference: Estimate
    p_value: float


def matched(agents: Sequence[Agent], factor: str, first: Any, second: Any) -> list[tuple[Agent, Agent]]:
    """Pairs of agents at the two levels of the factor that are equal in all other keys.

    Nothing is a level where the configuration says so (`task.time_limit: null`), not where it has no such key.
    """
    cells: dict[tuple[tuple[str, Any], ...], dict[Any, Agent]] = {}
    for agent in agents:
        if not _says(agent, factor):
            continue
        rest = tuple(sorted((k, v) for k, v in agent.key.items() if k != factor))
        cells.setdefault(rest, {})[agent.key.get(factor)] = agent
    found = [(cell[first], cell[second]) for cell in cells.values() if first in cell and second in cell]
    return sorted(found, key=lambda pair: pair[0].label)


def _says(agent: Agent, factor: str) -> bool:
    """Whether the agent has the factor at all: PPO has no `algo.tau`, and a limit in seconds that is null is one."""
    config = agent.runs[0].config
    return agent.key.get(factor) is not None or factor in config or f"{factor}.name" in config


def mean_difference(
    pairs: Sequence[tuple[Agent, Agent]], m: Measure, confidence: float
) -> tuple[Estimate, float]:
    """Return the mean over the pairs of first - second, with its interval, and the p-value of none.

    The pairs are taken as they are (the cells of this grid); what varies is seeds and scenarios. The p-value of one pair
    is that of `resolution`.
    """
    agents = list({id(agent): agent for pair in pairs for agent in pair}.values())
    sides = [sum((one is agent) - (other is agent) for one, other in pairs) for agent in agents]
    weights = np.array(sides) / len(pairs)
    table = m.table(agents)
    found = contrast(table, weights, confidence)
    p = float(resolution(table)[0, 1]) if len(pairs) == 1 else found.p_value
    return found.estimate, p


def effects(agents: Sequence[Agent], m: Measure, confidence: float = 0.95) -> list[Effect]:
    """The effects of each factor that varies among the agents with several training seeds.

    An agent with one seed is one policy: what it lacks may be its seed's luck and not the factor's doing.

    Of up to three levels every pair; of more numbers, the largest with the smallest; of more names, which have no order,
    every pair that is matched in several cells: of one cell the table has the pair itself. An effect that cannot be
    tested (no values, a single episode) is left out, as are agents with one training seed: they are policies, and
    what sets two of them apart is no effect of a factor.
    """
    learners = [agent for agent in agents if learns(agent) and len(agent.outcome) > 1]
    result = []
    for factor in learners[0].key if learners else ():
        levels = {agent.key.get(factor) for agent in learners if _says(agent, factor)}
        ordered = sorted(levels, key=lambda level: sort_key({"": level}))
        few = len(ordered) <= 3
        names = not all(isinstance(level, int | float) for level in ordered)
        chosen = list(combinations(ordered, 2)) if few or names else [(ordered[0], ordered[-1])]
        for second, first in chosen:
            pairs = matched(learners, factor, first, second)
            if len(pairs) >= (1 if few or not names else 2):
                estimate, p = mean_difference(pairs, m, confidence)
                if np.isfinite(p):
                    said = part(factor, first), part(factor, second)
                    result.append(Effect(factor, *said, tuple(pairs), estimate, p))
    return result

"""One training seed is one policy: what a row may be compared as, and how more seeds are trained."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from dataclasses import replace

from auvbench.analysis.effects import learns
from auvbench.analysis.records import Agent, RunRecord

COMPARE = ("algorithms", "policies")
"""What a row stands for: a configuration over its training seeds, or one training as it is."""
ENOUGH_SEEDS = 5
"""that the hint asks for: what a first table needs (docs/statistics.md, "What few seeds can say")"""


def one_policy(agent: Agent) -> bool:
    """Whether the agent is one trained policy: nothing is known of what another training would give."""
    return learns(agent) and len(agent.outcome) == 1


def rows_of(agents: Sequence[Agent], compare: str = "algorithms") -> list[Agent]:
    """The agents that get a row: as they are, or with `compare` "policies" one per training.

    Of a controller that does not learn its first run alone: seeds train nothing in it and are no sample.
    """
    one_run = [agent if learns(agent) or len(agent.runs) < 2 else _first(agent) for agent in agents]
    if compare != "policies":
        return one_run
    return [policy for agent in one_run for policy in (_trainings(agent) if learns(agent) else [agent])]


def _trainings(agent: Agent) -> list[Agent]:
    if len(agent.runs) == 1 and "seed" in agent.key:  # grouped by the seed already
        return [agent]
    return [
        replace(
            agent,
            label=f"{agent.label} seed {run.seed}",
            key={**agent.key, "seed": run.seed},
            runs=(run,),
            outcome=agent.outcome[[i]],
            metrics={column: values[[i]] for column, values in agent.metrics.items()},
        )
        for i, run in enumerate(agent.runs)
    ]


def _first(agent: Agent) -> Agent:
    metrics = {column: values[:1] for column, values in agent.metrics.items()}
    return replace(agent, runs=agent.runs[:1], outcome=agent.outcome[:1], metrics=metrics)


def more_seeds(agents: Sequence[Agent]) -> str:
    """The command that trains further seeds of the agents with one; '' where there are none, or where it is unknown.

    It is the command their runs were made by, with seeds: what is complete already is skipped.
    """
    single = [agent.runs[0] for agent in agents if one_policy(agent)]
    commands = dict.fromkeys(filter(None, map(_command, single)))
    if not commands:
        return ""
    others = {run.seed for run in single}
    wanted = sorted(others | set(range(max(ENOUGH_SEEDS, len(others)))))
    return " && ".join(_with_seeds(command, wanted) for command in list(commands)[:2])


def _command(run: RunRecord) -> str:
    command = run.manifest.get("command")
    return command if isinstance(command, str) and command.startswith("auvbench train") else ""


def _with_seeds(command: str, seeds: Sequence[int]) -> str:
    """The command as a grid over seeds.

    >>> _with_seeds("auvbench train algo=ppo seed=3", [0, 1, 3])
    'auvbench train -m algo=ppo seed=0,1,3'
    """
    words = [word for word in shlex.split(command)[2:] if not re.match(r"\+{0,2}seed=", word)]
    words = [word for word in words if word not in ("-m", "--multirun")]
    return f"auvbench train -m {shlex.join(words)} seed={','.join(map(str, seeds))}".replace("  ", " ")

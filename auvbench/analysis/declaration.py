"""Whether the analysis of a report was declared before its runs."""

from __future__ import annotations

from collections.abc import Sequence

from auvbench.analysis.effects import learns
from auvbench.analysis.formatting import counted, listed
from auvbench.analysis.records import Agent, RunRecord
from auvbench.runs import declared as files
from auvbench.runs.declared import Declared


def declaration(
    declared: Declared | None,
    runs: Sequence[RunRecord],
    agents: Sequence[Agent],
    *,
    instead: Sequence[str] = (),
    undecided: str = "",
) -> str:
    """Return in one line whether the analysis was declared before the first run.

    Args:
        declared: the analysis that was found with the runs.
        runs: all runs of the report, whose manifests carry the digest of the analysis they were made under.
        agents: of the table, whose seeds are compared with the planned ones.
        instead: options of the report that are not the declared ones.
        undecided: why none of several analyses is used.
    """
    if declared is None:
        return (
            undecided[:1].upper() + undecided[1:] + "."
            if undecided
            else "No analysis was declared before the runs."
        )
    if instead:
        return f"Not the declared analysis ({declared.digest}): {', '.join(instead)}."
    before = sum(run.manifest.get(files.KEY) == declared.digest for run in runs)
    if before == len(runs):
        text = f"The analysis was declared before the first run ({declared.digest})."
    else:
        after = f"{len(runs) - before} of {counted(len(runs), 'run')}"
        text = f"The analysis ({declared.digest}) was declared after {after} were made."
    return f"{text} {planned}" if (planned := _planned(declared, agents)) else text


def _planned(declared: Declared, agents: Sequence[Agent]) -> str:
    """Return which agents have another number of training seeds than was planned; '' where none."""
    other = [
        f"{agent.label} has {len(agent.runs)}"
        for agent in agents
        if learns(agent) and declared.seeds is not None and len(agent.runs) != declared.seeds
    ]
    return (
        f"Planned: {counted(declared.seeds, 'seed')}; {listed(other, 3)}." if other and declared.seeds else ""
    )

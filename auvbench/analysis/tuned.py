"""Who was tuned on the very scenarios that a table shows."""

from __future__ import annotations

from collections.abc import Sequence

from auvbench.analysis.formatting import listed
from auvbench.analysis.records import Agent, RunRecord


def tuned_on_these(agents: Sequence[Agent], protocol: str) -> str:
    """A sentence that must be read before such a table; '' where no agent was tuned on its scenarios."""
    found = [agent.label for agent in agents if any(_on_these(run, protocol) for run in agent.runs)]
    if not found:
        return ""
    one = len(found) == 1
    return (
        f"{listed(found, 4)} {'was' if one else 'were'} tuned on the scenarios of this table (protocol {protocol}): "
        f"{'its settings are' if one else 'their settings are each'} the luckiest of many trials here, so this is no ranking; "
        "protocol=test has scenarios that no tuning sees."
    )


def _on_these(run: RunRecord, protocol: str) -> bool:
    """Whether the run's settings were chosen on the scenarios of its evaluation by this protocol."""
    config = run.config
    evaluation = run.evaluations.get(protocol)
    if config.get("algo.tuned.protocol") is None or evaluation is None:
        return False
    summary = evaluation.summary
    # Summaries that were written before they said from which stream their scenarios come have the name.
    same = (
        summary.get("scenarios") == config.get("algo.tuned.scenarios")
        or protocol == config["algo.tuned.protocol"]
    )
    return bool(same and summary.get("seed") == config.get("algo.tuned.seed"))

"""Apply the names that an analysis gives to agents, instead of labels made from their configurations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from auvbench.analysis.formatting import listed
from auvbench.analysis.records import RunRecord
from auvbench.errors import ReportError, UserError
from auvbench.runs import run_filter


def name_agents(runs: Sequence[RunRecord], names: Mapping[str, str]) -> list[RunRecord]:
    """Return the runs with the names of their agents (`RunRecord.name`).

    Args:
        runs: loaded runs.
        names: for each agent's name, the terms that the agent's runs must match: {"PPO, no currents":
            "algo=ppo disturbance.current.speed_high=null"}. Terms are written as in `--where`, separated by
            spaces. A run that matches the terms of several names gets the first of these names.

    Raises:
        ReportError: a term is not KEY=VALUE.
    """
    terms = {}
    for name, text in names.items():
        try:
            terms[name] = run_filter.parse(text.split())
        except UserError as error:
            raise ReportError(f"names: {name}: {str(error).removeprefix('--where ')}") from error
    return (
        [replace(run, name=next((n for n in terms if _fits(run, terms[n])), "")) for run in runs]
        if terms
        else [*runs]
    )


def _fits(run: RunRecord, terms: Sequence[run_filter.Term]) -> bool:
    return all(term.holds(run.config.get(term.key, run.config.get(f"{term.key}.name"))) for term in terms)


def with_names(labels: Sequence[str], agents: Sequence[Sequence[RunRecord]]) -> list[str]:
    """Return the agents' labels; if all runs of an agent have the same name, this name replaces the label.

    Raises:
        ReportError: several agents have the same name.
    """
    names = [{run.name for run in runs} for runs in agents]
    named = [next(iter(own)) if len(own) == 1 else "" for own in names]
    for name in filter(None, named):
        matches = [label for label, own in zip(labels, named, strict=True) if own == name]
        if len(matches) > 1:
            raise ReportError(
                f"names: {name} fits {listed(matches, 4)}; add a term that only one of them has"
            )
    return [name or label for label, name in zip(labels, named, strict=True)]

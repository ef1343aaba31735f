"""Compare agents with the baseline under each condition of several protocols.

Each condition is a separate analysis: its intervals hold simultaneously over all agents, but not over all
conditions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from auvbench.analysis.grouping import agents
from auvbench.analysis.measures import in_unit
from auvbench.analysis.options import Options
from auvbench.analysis.ranking import rank
from auvbench.analysis.records import Ranking, Report


@dataclass(frozen=True, slots=True)
class Subject:
    """Comparisons of one vehicle and task, by condition."""

    name: str
    """vehicle and task: 'rexrov, task docking'"""
    rankings: tuple[Ranking, ...]
    """one ranking per condition, in the order of the protocols and of their conditions"""

    @property
    def labels(self) -> list[str]:
        """Return all labels: agents of the first condition in its ranking order, then agents that only later conditions have."""
        return list(dict.fromkeys(row.label for ranking in self.rankings for row in ranking.rows))


def of_protocol(options: Options, protocol: str) -> Options:
    """Return a report's options for another protocol (an entry of `also`), without a condition and a study."""
    return replace(options, protocol=protocol, condition=None, study=None)


def compare(tested: Sequence[tuple[Options, Sequence[Report]]]) -> list[Subject]:
    """Compare all agents under each condition of several protocols.

    Args:
        tested: for each protocol, the options and the reports that `analyse` returns for them.
    """
    rankings: dict[str, list[Ranking]] = {}
    for options, reports in tested:
        largest = {report.section.vehicle: report for report in reversed(reports)}
        for subject, report in reversed(largest.items()):
            rankings.setdefault(subject, []).extend(_under_each(report, options))
    return [Subject(name, tuple(own)) for name, own in rankings.items()]


def _under_each(report: Report, options: Options) -> list[Ranking]:
    usual = report.ranking
    baseline = usual.primary.baseline if usual.primary else None
    rankings = []
    for condition in [c.name for c in usual.conditions] or [usual.condition]:
        if condition == usual.condition:
            rankings.append(usual)
            continue
        tested, _ = agents(report.runs, options.protocol, condition)
        rankings.append(
            rank(
                tested,
                rank_by=usual.rank_by,
                baseline=baseline,
                confidence=options.confidence,
                margin=in_unit(options.margin, usual.rank_by),
                protocol=options.protocol,
                condition=condition,
            )
        )
    return rankings

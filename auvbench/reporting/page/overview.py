"""The first page of a report of several sections: table and findings of each, with links to the rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from auvbench.analysis.aggregate import Across
from auvbench.analysis.findings import SHOWN
from auvbench.analysis.headline import headline
from auvbench.analysis.records import Agent, Finding, Ranking, RunRecord
from auvbench.reporting.page import numbers, sources, table
from auvbench.reporting.page.links import Links
from auvbench.reporting.page.writer import over_all, render, title_of
from auvbench.reporting.tables.main import main_table
from auvbench.reporting.tables.notes import grouped, notes
from auvbench.reporting.write import text


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """One section of the report."""

    title: str
    folder: str
    """of its own report, below the folder of the overview"""
    ranking: Ranking
    agents: Sequence[Agent]
    runs: Sequence[RunRecord]
    findings: Sequence[Finding]


def write_overview(path: Path, parts: Sequence[Part], command: str = "", over: Across | None = None) -> Path:
    """Write the page of all sections; each has its own page at `<folder>/index.html`.

    Raises:
        OSError: the file cannot be written.
    """
    shown = []
    for part in parts:
        href = f"./{part.folder}/index.html"
        links = Links(path, part.agents, part.runs, part.ranking.protocol, href)
        shown.append(
            {
                "title": part.title,
                "heading": part.title[:1].upper() + part.title[1:],
                "headline": numbers.minus(headline(part.ranking)),
                "fingerprint": part.ranking.fingerprint,
                "href": href,
                "table": table.of_agents(main_table(part.ranking), part.ranking, {}, links),
                "notes": [numbers.minus(line) for line in notes(part.ranking)],
                "findings": sources.findings(part.findings[:SHOWN], links),
            }
        )
    first = parts[0].ranking
    runs = [run for part in parts for run in part.runs]
    facts = sources.facts(first, [agent for part in parts for agent in part.agents], runs)
    html = render(
        runs,
        first,
        title=title_of(runs),
        headline=f"{len(parts)} sections: agents are compared on one vehicle and the same scenarios, never across.",
        parts=shown,
        problems=grouped(
            tuple(dict.fromkeys(problem for part in parts for problem in part.ranking.problems))
        ),
        facts=[fact for fact in facts if fact[0] != "Scenarios"],  # each section has its own
        command=command,
        over=over_all(over),
    )
    return text(path, html)

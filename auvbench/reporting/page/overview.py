"""The first page of a report of several sections: the ranked table and the findings of each, and where the rest is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from auvbench.analysis.aggregate import Across
from auvbench.analysis.model import Agent, Finding, Ranking, RunRecord
from auvbench.reporting.page import sources, table
from auvbench.reporting.page.links import Links
from auvbench.reporting.page.sources import Sentence
from auvbench.reporting.page.writer import hues_of, over_all, render, title_of
from auvbench.reporting.tables.notes import grouped
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
    colours: Mapping[str, tuple[str, Any, Any]]


@dataclass(frozen=True, slots=True)
class _Shown:
    """What the template draws of a section."""

    title: str
    heading: str
    fingerprint: str
    href: str
    table: table.Table
    findings: list[Sentence]


def write_overview(path: Path, parts: Sequence[Part], command: str = "", over: Across | None = None) -> Path:
    """Writes the page of all sections; each has a page of its own at `<folder>/index.html` beside it.

    Raises:
        OSError: the file cannot be written.
    """
    shown = []
    for part in parts:
        links = Links(path, part.agents, part.runs, part.ranking.protocol, f"./{part.folder}/index.html")
        hues = hues_of(part.agents, part.colours)
        shown.append(
            _Shown(
                part.title,
                part.title[:1].upper() + part.title[1:],
                part.ranking.fingerprint,
                f"./{part.folder}/index.html",
                table.main_table(part.ranking, hues, links),
                sources.sentences(part.findings, links),
            )
        )
    first = parts[0].ranking
    runs = [run for part in parts for run in part.runs]
    problems = tuple(dict.fromkeys(problem for part in parts for problem in part.ranking.problems))
    facts = sources.facts(first, [agent for part in parts for agent in part.agents], runs)
    html = render(
        runs,
        first,
        title=title_of(runs),
        parts=shown,
        problems=grouped(problems),
        facts=[fact for fact in facts if fact.name != "Scenarios"],  # each section has its own
        command=command,
        over=over_all(over),
    )
    return text(path, html)

"""Puts the parts of a report into files."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

from auvbench.analysis import study
from auvbench.analysis.aggregate import Across
from auvbench.analysis.model import Comparison, Finding, Ranking
from auvbench.analysis.study import Beside
from auvbench.reporting import tables
from auvbench.reporting.figures import Figure
from auvbench.reporting.tables.markdown import escape
from auvbench.reporting.tables.notes import of_pairs
from auvbench.runs.files import as_json, write_atomic


def text(path: Path, content: str) -> Path:
    """Writes a file whole or not at all, so that a report that was interrupted leaves the last one.

    Raises:
        OSError: it cannot be written.
    """
    write_atomic(path, content.encode("utf-8", "replace"))
    return path


def if_any(path: Path, content: str) -> list[Path]:
    """Writes the file where there is content; else an earlier report's goes."""
    if content:
        return [text(path, content)]
    path.unlink(missing_ok=True)
    return []


def against_baseline(ranking: Ranking) -> tuple[Comparison, ...]:
    """The comparisons that get a table of their own: each agent against the baseline, in the ranking's order."""
    found = {}
    for x in ranking.comparisons:
        if x.second == ranking.baseline:
            found[x.first] = x
        elif x.first == ranking.baseline:
            found[x.second] = _reversed(x)
    return tuple(found[row.label] for row in ranking.rows if row.label in found)


def _reversed(x: Comparison) -> Comparison:
    """The same comparison seen from the other agent."""
    d, p = x.difference, x.probability_of_improvement
    return replace(
        x,
        verdict={"better": "worse", "worse": "better"}.get(x.verdict, x.verdict),
        first=x.second,
        second=x.first,
        difference=replace(d, value=-d.value, low=-d.high, high=-d.low),
        probability_of_improvement=replace(p, value=1 - p.value, low=1 - p.high, high=1 - p.low),
    )


def markdown(
    ranking: Ranking,
    findings: Sequence[Finding],
    claims: Sequence[Finding],
    beside: Sequence[Beside],
    figures: Sequence[Figure],
    folder: Path,
    over: Across | None = None,
) -> str:
    """report.md: the table, what it says, comparisons, claims, figures; links are relative to `folder`.

    Args:
        ranking: the table.
        findings: sentences that the data generate.
        claims: claims of a study with their verdicts.
        beside: the study's own numbers next to ours.
        figures: drawn already.
        folder: where report.md will lie.
        over: the agents over all tasks, where that was asked for.
    """
    parts = ["# Report", tables.markdown(ranking).rstrip()]
    if ranking.conditions:
        parts += ["## Conditions", tables.conditions_markdown(ranking).rstrip()]
    if over is not None:
        parts += ["## Over all tasks", tables.across_markdown(over).rstrip()]
    if findings:
        parts += ["## Findings", "\n".join(f"- {finding_in_markdown(finding)}" for finding in findings)]
    if comparisons := against_baseline(ranking):
        parts += [f"## Against {escape(ranking.baseline or '')}"]
        parts += [tables.comparisons_markdown(comparisons).rstrip(), escape(of_pairs(ranking))]
    if claims:
        parts += [
            "## Claims of the study",
            "\n".join(f"{i}. {finding_in_markdown(f)}" for i, f in enumerate(claims, 1)),
        ]
    if beside:
        parts += ["## The study's table and ours", study.markdown(beside).rstrip()]
    if figures:
        parts.append("## Figures")
    for figure in figures:
        link = Path(os.path.relpath(figure.png, folder)).as_posix()
        parts += [
            f"### {escape(figure.title)}",
            f"![{escape(figure.title)}](<{link}>)",
            escape(figure.caption),
        ]
    return "\n\n".join(parts) + "\n"


def verdicts(claims: Sequence[Finding], findings: Sequence[Finding]) -> str:
    """verdicts.json: each claim of a study with its verdict, then each finding, both in their order; empty without any."""
    said = [{"claim": i, **asdict(claim)} for i, claim in enumerate(claims, 1)]
    said += [{"finding": i, **asdict(finding)} for i, finding in enumerate(findings, 1)]
    return as_json(said).decode() if said else ""


def finding_in_markdown(finding: Finding) -> str:
    text = escape(finding.text)
    if finding.verdict:
        text += f" **{escape(finding.verdict[0].upper() + finding.verdict[1:])}.**"
    for more in (finding.statistic, finding.missing and f"Missing: {finding.missing}"):
        text += f" {escape(more)}" if more else ""
    return text

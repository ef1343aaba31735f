"""Write the parts of a report into files, with all facts that a reader needs to judge and repeat its numbers."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from auvbench.analysis.findings import SHOWN
from auvbench.analysis.formatting import capitalized
from auvbench.analysis.records import ClaimVerdict, Finding, Report, RunRecord
from auvbench.analysis.score import Scores
from auvbench.reporting import tables
from auvbench.reporting.figures import FIGURES, MAIN, Figure
from auvbench.reporting.tables.table import Table
from auvbench.reporting.tables.text_formats import escape
from auvbench.runs.atomic_io import as_json, write_atomic
from auvbench.statistics.intervals import Estimate


def text(path: Path, content: str) -> Path:
    """Write a file atomically, and return its path.

    Raises:
        OSError: the file cannot be written.
    """
    write_atomic(path, content.encode("utf-8", "replace"))
    return path


def if_any(path: Path, content: str) -> list[Path]:
    """Write a file and return its path as a list; if the content is empty, remove the file of an earlier report."""
    if content:
        return [text(path, content)]
    path.unlink(missing_ok=True)
    return []


def markdown(report: Report, figures: Sequence[Figure], folder: Path, further: Sequence[Table] = ()) -> str:
    """Return the content of report.md of one section, with the tables `further` at the end.

    Links are relative to `folder`, the folder of report.md.
    """
    ranking = report.ranking
    main = next((figure for figure in figures if figure.name == MAIN), None)
    parts = ["# Report", tables.markdown(ranking, figure_in_markdown(main, folder) if main else "").rstrip()]
    if report.findings:
        parts += ["## Findings", findings_in_markdown(report.findings)]
    for conditions in tables.conditions_tables(ranking):
        parts += [f"## {escape(conditions.title)}", tables.pipes(conditions)]
    parts += _titled(further)
    if report.claims:
        parts += ["## Claims of the study", claims_in_markdown(report.claims)]
    if comparison := tables.comparison_table(report.comparison):
        parts += [f"## {comparison.title}", tables.pipes(comparison)]
    remaining = [figure for figure in figures if figure is not main]
    if remaining:
        parts.append("## Figures")
        parts += [f"### {escape(f.title)}\n\n{figure_in_markdown(f, folder)}" for f in remaining]
    parts += ["## Appendix: ranks", tables.pipes(tables.ranks_table(ranking))]
    return "\n\n".join(parts) + "\n"


def _titled(further: Sequence[Table]) -> list[str]:
    return [text for table in further for text in (f"## {escape(table.title)}", tables.pipes(table))]


def figure_in_markdown(figure: Figure, folder: Path) -> str:
    """Return Markdown that shows a figure with its caption; the link is relative to `folder`."""
    link = Path(os.path.relpath(figure.png, folder)).as_posix()
    return f"![{escape(figure.title)}](<{link}>)\n\n{escape(figure.caption)}"


def verdicts(reports: Sequence[Report]) -> str:
    """Return the content of verdicts.json: the claims and findings of each section; '' without claims and findings.

    With several sections, each claim and each finding names its section.
    """
    rows: list[dict[str, Any]] = []
    for report in reports:
        section = {"section": report.section.title} if len(reports) > 1 else {}
        rows += [{**section, "claim": i, **asdict(claim)} for i, claim in enumerate(report.claims, 1)]
        for i, finding in enumerate(report.findings, 1):
            rows.append({**section, "finding": i, **asdict(finding)})
            if finding.estimate is not None:
                rows[-1]["estimate"] = _numbers(finding.estimate)
    return as_json(rows).decode() if rows else ""


def _numbers(estimate: Estimate) -> dict[str, Any]:
    ends = {key: value for key, value in asdict(estimate).items() if value == value}
    return {"low": None, "high": None, "value": None} | ends


def findings_in_markdown(findings: Sequence[Finding]) -> str:
    """Return Markdown with the first findings as a list and the others folded; the method of a finding is in brackets."""
    lines = [f"* {escape(f.text + (f' ({f.basis})' if f.basis else ''))}" for f in findings]
    shown, folded = lines[:SHOWN], lines[SHOWN:]
    if folded:
        inside = "\n".join(folded)
        shown += ["", f"<details><summary>{len(folded)} more</summary>", "", inside, "", "</details>"]
    return "\n".join(shown)


def claims_in_markdown(claims: Sequence[ClaimVerdict]) -> str:
    """Return the numbered claims with their verdicts and evidence."""
    lines = []
    for i, claim in enumerate(claims, 1):
        verdict = escape(f"{capitalized(claim.verdict)}.")
        more = [claim.statistic, claim.missing and f"Missing: {claim.missing}"]
        lines.append(" ".join([f"{i}. {escape(claim.text)} **{verdict}**", *map(escape, filter(None, more))]))
    return "\n".join(lines)


OF_ONE_SECTION = ("table.tex", "conditions.tex", "conditions.csv", "comparisons.csv", "verdicts.json")
"""files that a report of one section has, but an overview of several sections does not"""


def overview(sections: int, score: Scores | None) -> str:
    """Return the headline of a report with several sections."""
    if score is None or not score.rows:
        return (
            f"{sections} sections: agents are compared on one vehicle and the same scenarios, never across."
        )
    return f"{len(score.titles)} tasks: agents are compared within each task, and a score describes them across tasks."


def sections_markdown(
    reports: Sequence[Report], score: Scores | None = None, further: Sequence[Table] = ()
) -> str:
    """Return the content of report.md for several sections.

    The file has the scores across tasks, the table and findings of each section with a link to the section's report,
    and the tables `further`.
    """
    pieces = ["# Report", overview(len(reports), score)]
    if score is not None:
        pieces += ["## Score across tasks", tables.pipes(tables.score_table(score))]
    for report in reports:
        title = report.section.title
        pieces += [
            f"## {escape(capitalized(title))}",
            tables.markdown(report.ranking).rstrip(),
            findings_in_markdown(report.findings),
            f"[All of {escape(title)}](<{report.section.folder}/report.md>)",
        ]
    return "\n\n".join(filter(None, [*pieces, *_titled(further)])) + "\n"


def clear(out: Path) -> None:
    """Remove the files that an earlier report of a single section left in the folder."""
    stale = [out / name for name in OF_ONE_SECTION]
    stale += [out / "figures" / f"{name}{suffix}" for name in FIGURES for suffix in (".png", ".svg")]
    for path in stale:
        path.unlink(missing_ok=True)


Facts = list[tuple[str, tuple[str, ...]]]
"""names of facts, each with the distinct values of the runs"""


def facts(runs: Sequence[RunRecord]) -> Facts:
    """Return vehicles, simulators, versions, commits and machines of the runs; a fact that no run records is left out."""
    versions, commits, hosts = (
        [entries for run in runs if (entries := run.manifest.get(key))] for key in ("versions", "git", "host")
    )
    packages = sorted({str(name) for entries in versions for name in entries})
    entries = [
        ("Vehicle", distinct(run.config.get("vehicle.name") for run in runs)),
        ("Simulator", distinct(run.config.get("simulator.name") for run in runs)),
        ("Versions", tuple(f"{n} {' and '.join(distinct(v.get(n) for v in versions))}" for n in packages)),
        ("Source", distinct(_commit(git) for git in commits)),
        ("Hosts", distinct(f"{host.get('cpu')}, {host.get('cores')} cores" for host in hosts)),
    ]
    return [(name, values) for name, values in entries if values]


def _commit(git: Mapping[str, Any]) -> str:
    commit = str(git.get("commit") or "")[:12]
    return f"commit {commit}{' with local changes' if git.get('dirty') else ''}" if commit else ""


def distinct(values: Iterable[Any]) -> tuple[str, ...]:
    """Return the distinct values as sorted texts, without missing values."""
    return tuple(sorted({str(value) for value in values if value is not None and value != ""}))

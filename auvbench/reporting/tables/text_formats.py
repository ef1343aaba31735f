"""Tables as CSV in full precision."""

from __future__ import annotations

import csv as csv_module
import io
from collections.abc import Iterable, Sequence
from typing import Any

from auvbench.analysis.primary import headline
from auvbench.analysis.records import Comparison, Ranking, Row
from auvbench.analysis.score import Scores
from auvbench.analysis.thesis import ComparisonRow
from auvbench.reporting.tables.appendix import (
    COMPARISON_NOTE,
    comparison_table,
    conditions_note,
    conditions_table,
    ranks_table,
    score_notes,
    score_table,
)
from auvbench.reporting.tables.main import main_table
from auvbench.reporting.tables.notes import grouped, notes
from auvbench.reporting.tables.table import Table
from auvbench.untrusted.text import cell


def csv(ranking: Ranking) -> str:
    """Return a row per agent: the primary analysis, the key, seeds, runs, and every metric (rates from 0 to 1)."""
    keys = list(dict.fromkeys(key for row in ranking.rows for key in row.key))
    metrics = list(dict.fromkeys(metric for row in ranking.rows for metric in row.estimates))
    header = ["agent", "budget", "baseline", "margin"]
    header += ["difference", "difference_low", "difference_high", "verdict", "needed", "needed_unit"]
    header += ["rank", "rank_low", "rank_high", "group", "compared", *keys]
    header += [
        "seeds",
        "succeeded",
        "runs",
        "episodes",
        "protocol",
        "condition",
        "fingerprint",
        "confidence",
        "covers",
    ]
    header += [name for metric in metrics for name in (metric, f"{metric}_low", f"{metric}_high")]
    rows = []
    for row in ranking.rows:
        line: list[Any] = [row.label, " ".join(map(str, row.budget)), *_against(ranking, row)]
        line += [row.rank, *row.rank_interval, row.group, int(row.compared)]
        line += [row.key.get(key) for key in keys]
        covers = "; ".join(dict.fromkeys(estimate.covers for estimate in row.estimates.values()))
        line += [" ".join(map(str, row.seeds)), row.succeeded if row.trained else None]
        line += [" ".join(row.run_ids), row.episodes, ranking.protocol]
        line += [ranking.condition, ranking.fingerprint, ranking.confidence, covers]
        for metric in metrics:
            estimate = row.estimates.get(metric)
            line += [None] * 3 if estimate is None else [estimate.value, estimate.low, estimate.high]
        rows.append(line)
    return lines(header, rows)


def _against(ranking: Ranking, row: Row) -> list[Any]:
    """Return baseline, margin, difference with its ends, verdict and what would decide an open one."""
    primary = ranking.primary
    if primary is None:
        return [None] * 8
    start: list[Any] = [primary.baseline, primary.margin]
    against = primary.of(row.label)
    if against is None:
        return [*start, 0.0, None, None, "baseline", None, None]
    d, needed = against.difference, against.needed
    return [
        *start,
        d.value,
        d.low,
        d.high,
        against.verdict,
        needed.count if needed else None,
        needed.unit if needed else None,
    ]


def conditions_csv(ranking: Ranking) -> str:
    """A row per agent and condition of the protocol; an empty string for one condition.

    Success from 0 to 1, and the changes of success and of PAR-1 steps against the undisturbed condition, paired by seed and
    scenario: empty where there is none, where seeds did not meet both, and of steps where frequency or limit differ.
    """
    if not ranking.conditions:
        return ""
    names = ("success_rate", "success_change", "par1_change")
    header = [
        "agent",
        "condition",
        *(f"{name}{end}" for name in names for end in ("", "_low", "_high")),
        "covers",
    ]
    rows = []
    for row in ranking.rows:
        for condition in ranking.conditions:
            if success := condition.success.get(row.label):
                changes = (c.get(row.label) for c in (condition.success_change, condition.par1_change))
                numbers = [
                    n for e in (success, *changes) for n in ((e.value, e.low, e.high) if e else ("",) * 3)
                ]
                rows.append([row.label, condition.name, *numbers, success.covers])
    return lines(header, rows)


def comparisons_csv(comparisons: Sequence[Comparison]) -> str:
    """Return a row per pair of agents; an empty string without any."""
    if not comparisons:
        return ""
    header = ["first", "second", "metric", "difference", "difference_low", "difference_high", "p", "p_holm"]
    rows = []
    for x in comparisons:
        d = x.difference
        rows.append([x.first, x.second, x.metric, d.value, d.low, d.high, x.p_value, x.p_adjusted, x.verdict])
    return lines([*header, "verdict"], rows)


def joined(column: str, parts: Sequence[tuple[str, str]]) -> str:
    """Return the rows of several CSV texts; the first column has the name of each text. A missing column is empty."""
    rows = [
        {column: cell(name), **row}
        for name, text in parts
        for row in csv_module.DictReader(io.StringIO(text))
    ]
    if not rows:
        return ""
    buffer = io.StringIO()
    columns = list(dict.fromkeys(name for row in rows for name in row))
    writer = csv_module.DictWriter(buffer, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return buffer.getvalue()


def lines(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """CSV whose floats are written by repr, so that they read back as the same number; NaN is an empty cell."""
    buffer = io.StringIO()
    writer = csv_module.writer(buffer, lineterminator="\n")
    writer.writerow(header)
    for row in rows:
        # A spreadsheet would take a label that begins with = for a formula.
        writer.writerow(["" if value is None or value != value else cell(_plain(value)) for value in row])
    return buffer.getvalue()


def _plain(value: Any) -> Any:
    return float(value) if isinstance(value, float) else value


def escape(text: str) -> str:
    r"""Text that Markdown takes literally inside a cell.

    >>> print(escape("a|b_c<d>"))
    a\|b\_c&lt;d&gt;
    """
    for character in "\\`*_|[]":
        text = text.replace(character, f"\\{character}")
    return text.replace("<", "&lt;").replace(">", "&gt;")


def pipes(table: Table) -> str:
    """Return a pipe table; intervals stand behind their values."""
    rules = ["---" if heading.words else "---:" for heading in table.headings]
    headings = [escape(heading.text) for heading in table.headings]
    return rows([headings, rules, *([escape(cell.text) for cell in line.cells] for line in table.lines)])


def rows(cells: Iterable[Iterable[str]]) -> str:
    """Return rows of Markdown between pipes: headings, rules, entries."""
    return "\n".join("| " + " | ".join(row) + " |" for row in cells)


def markdown(ranking: Ranking, figure: str = "") -> str:
    """Return the headline, the main figure, the main table, its notes and the list of what is not in it.

    Args:
        ranking: the table.
        figure: the main figure as Markdown.
    """
    parts = [f"**{escape(headline(ranking))}**", *filter(None, [figure]), *map(escape, ranking.notices)]
    parts.append(pipes(main_table(ranking)))
    parts.append("\n".join(f"* {escape(line)}" for line in notes(ranking)))
    for title, problems in grouped(ranking.problems):
        lines = [f"- {escape(p.where)}: {escape(p.message)}" for p in problems]
        parts.append("\n".join([f"**{title[0].upper()}{title[1:]} ({len(problems)})**", "", *lines]))
    return "\n\n".join(parts) + "\n"


def conditions_markdown(ranking: Ranking) -> str:
    """Return success under each condition of the protocol; an empty string where it has only one."""
    if not ranking.conditions:
        return ""
    return f"{pipes(conditions_table(ranking))}\n\n{escape(conditions_note(ranking))}\n"


def ranks_markdown(ranking: Ranking) -> str:
    """Return the ranks with their intervals and group letters: the exploratory part."""
    return pipes(ranks_table(ranking)) + "\n"


def comparison_markdown(rows: Sequence[ComparisonRow]) -> str:
    """Return the original study's numbers and ours."""
    return f"{pipes(comparison_table(rows))}\n\n{COMPARISON_NOTE}\n"


def score_csv(found: Scores) -> str:
    """Return a row per agent in full precision; an empty string without a score."""
    if not found.rows:
        return ""
    keys = list(dict.fromkeys(key for row in found.rows for key in row.key))
    header = ["agent", *keys, "protocol", "confidence", "score", "score_low", "score_high"]
    header += [f"{what}: {title}" for what in ("score", "measure", "seeds") for title in found.titles]
    measures = [m.name for m in found.measures]
    rows = []
    for row in found.rows:
        line = [row.label, *(row.key.get(key) for key in keys), found.protocol, found.confidence]
        line += [row.score.value, row.score.low, row.score.high, *row.tasks, *measures, *row.trainings]
        rows.append(line)
    return lines(header, rows)


def score_markdown(found: Scores) -> str:
    """Return the table and its notes."""
    table = [pipes(score_table(found))] if found.rows else []
    return "\n\n".join([*table, "\n".join(f"* {escape(line)}" for line in score_notes(found))]) + "\n"

"""Format tables as text: CSV in full precision, Markdown, and LaTeX for a paper.

LaTeX tables use booktabs. Their intervals are below the values, and a table that is too wide is shrunk to the width of
the text.
"""

from __future__ import annotations

import csv as csv_module
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from auvbench.analysis.by_condition import Subject
from auvbench.analysis.formatting import capitalized, counted
from auvbench.analysis.labels import VEHICLE
from auvbench.analysis.pairwise import UNDECIDED
from auvbench.analysis.primary import headline
from auvbench.analysis.records import Comparison, Ranking, Row
from auvbench.analysis.score import Scores
from auvbench.reporting.tables.main import grouped, main_table
from auvbench.reporting.tables.table import SHOWN_NOTES, Cell, Heading, Table
from auvbench.statistics.intervals import Estimate
from auvbench.statistics.reliability import Reliability
from auvbench.untrusted.text import cell

HEAD = r"% \usepackage{booktabs} \usepackage{graphicx} \usepackage{amssymb} \usepackage[T1]{fontenc}"

_SPECIAL = {
    "\\": r"\textbackslash{}",
    "{": r"\{",
    "}": r"\}",
    "$": r"\$",
    "&": r"\&",
    "#": r"\#",
    "%": r"\%",
    "_": r"\_",
    "^": r"\textasciicircum{}",
    "~": r"\textasciitilde{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    '"': r"\textquotedbl{}",
    "–": "--",
    "†": r"\textdagger{}",
    "×": r"$\times$",
    "−": "$-$",
    "±": r"$\pm$",
    "▲": r"$\blacktriangle$",
    "■": r"$\blacksquare$",
    "▼": r"$\blacktriangledown$",
    "○": r"$\circ$",
}
_MARKDOWN = str.maketrans(
    {character: f"\\{character}" for character in "\\`*_|[]"} | {"<": "&lt;", ">": "&gt;"}
)


def csv(ranking: Ranking) -> str:
    """Return the ranking as CSV, with one row per agent.

    The columns are the primary analysis, rank, the agent's key, seeds, runs and every metric; rates are from 0 to 1.
    """
    metrics = list(dict.fromkeys(metric for row in ranking.rows for metric in row.estimates))
    keys = list(dict.fromkeys(key for row in ranking.rows for key in row.key))
    timed = any(row.trial_s is not None for row in ranking.rows)  # older searches did not record this time
    rows = []
    for row in ranking.rows:
        line: dict[str, Any] = {"agent": row.label, "budget": " ".join(map(str, row.budget))}
        line |= _against(ranking, row)
        line |= {"rank": row.rank, "rank_low": row.rank_interval[0], "rank_high": row.rank_interval[1]}
        line["compared"] = int(row.compared)
        # The agent's vehicle is in the column `sheet`, because a column `vehicle` contains the section's vehicle.
        line |= {"sheet" if key == VEHICLE else key: row.key.get(key) for key in keys}
        line |= {
            "seeds": " ".join(map(str, row.seeds)),
            "succeeded": row.succeeded if row.trained else None,
            "knows": "; ".join(row.knows),
            "tuning_trials": row.trials,
            "runs": " ".join(row.run_ids),
            "episodes": row.episodes,
            "protocol": ranking.protocol,
            "condition": ranking.condition,
            "fingerprint": ranking.fingerprint,
            "confidence": ranking.confidence,
            "covers": "; ".join(dict.fromkeys(estimate.covers for estimate in row.estimates.values())),
        }
        if timed:
            line |= {"tuning_steps": row.trial_steps, "tuning_cpu_s": row.trial_s}
        for metric in metrics:
            line |= _with_ends(metric, row.estimates.get(metric))
        rows.append(line)
    return lines(rows)


def _against(ranking: Ranking, row: Row) -> dict[str, Any]:
    """Return the cells of an agent's primary analysis by column.

    The cells are baseline, margin, difference with its limits, verdict, numbers of trainings or episodes that
    would decide an open comparison, and reliability.
    """
    primary = ranking.primary
    against = primary.of(row.label) if primary else None
    needed = against.needed if against else None
    line: dict[str, Any] = {
        "baseline": primary.baseline if primary else None,
        "margin": primary.margin if primary else None,
        **_with_ends("difference", against.difference if against else None),
        "verdict": against.marked_verdict if against else None,
        "trainings": (against.trainings or None) if against else None,
        "enough": against.enough if against and against.trainings else None,
        "needed": needed.count if needed else None,
        "needed_unit": needed.unit if needed else None,
        **_not_behind("not_behind", against.own_reliability if against else None),
    }
    if primary and against is None:
        line |= {"difference": 0.0, "verdict": "baseline"}
    return line


def _not_behind(name: str, reliability: Reliability | None) -> dict[str, float | None]:
    """Return the cells of a reliability by column: number of trainings that are not behind, and limits of their share.

    The name "not_behind" adds cells on the effect of failing trainings. If `reliability` is None, all cells are
    empty (None).
    """
    shares: dict[str, float | None] = {name: None, f"{name}_low": None, f"{name}_high": None}
    if reliability is not None:
        shares = {name: reliability.count, f"{name}_low": reliability.low, f"{name}_high": reliability.high}
    if name == "not_behind":
        shares |= {
            "failing_excluded": reliability.excluded if reliability else None,
            "mean_turns": reliability.mean_turns if reliability else None,
        }
    return shares


def _with_ends(name: str, estimate: Estimate | None) -> dict[str, float | None]:
    """Return three cells by column: an estimate's value and its two limits; without an estimate, the cells are None."""
    values = (None,) * 3 if estimate is None else (estimate.value, estimate.low, estimate.high)
    return dict(zip((name, f"{name}_low", f"{name}_high"), values, strict=True))


def conditions_csv(ranking: Ranking) -> str:
    """Return CSV with one row per agent and condition of the protocol; '' for a single condition.

    The columns are task, agent, condition, success from 0 to 1, and the changes of success and PAR-1 steps from
    the undisturbed condition, paired by seed and scenario. A change is empty if the protocol has no undisturbed
    condition, or if a seed was not tested under both conditions. A change of steps is also empty if the two
    conditions have different frequencies or step limits. The ranking measure has additional columns, unless it is a
    rate or a penalised time.
    """
    measured = any(condition.measured for condition in ranking.conditions)
    return lines(
        {
            "task": ranking.task,
            "agent": row.label,
            "condition": condition.name,
            **_with_ends("success_rate", success),
            **_with_ends("success_change", condition.success_change.get(row.label)),
            **_with_ends("par1_change", condition.par1_change.get(row.label)),
            "covers": success.covers,
            **(_with_ends(ranking.rank_by, condition.measured.get(row.label)) if measured else {}),
        }
        for row in ranking.rows
        for condition in ranking.conditions
        if (success := condition.success.get(row.label))
    )


def by_condition_csv(subjects: Sequence[Subject]) -> str:
    """Return CSV with one row per vehicle, task, condition and agent: means, and the comparison with the baseline."""
    return lines(
        {
            "vehicle": subject.name,
            "protocol": ranking.protocol,
            "condition": ranking.condition,
            "agent": row.label,
            "measure": ranking.rank_by,
            **_with_ends("mean", row.estimates.get(ranking.rank_by)),
            **_with_ends("success_rate", row.estimates.get("success_rate")),
            **_against(ranking, row),
            "episodes": row.episodes,
            "confidence": ranking.confidence,
        }
        for subject in subjects
        for ranking in subject.rankings
        for row in ranking.rows
    )


def score_csv(scores: Scores) -> str:
    """Return the scores as CSV in full precision, with one row per agent; '' without scores."""
    keys = list(dict.fromkeys(key for row in scores.rows for key in row.key))
    rows = []
    for row in scores.rows:
        line: dict[str, Any] = {"agent": row.label, **{key: row.key.get(key) for key in keys}}
        line |= {
            "protocol": scores.protocol,
            "confidence": scores.confidence,
            **_with_ends("score", row.score),
        }
        for what, values in (
            ("score", row.tasks),
            ("measure", [m.name for m in scores.measures]),
            ("seeds", row.trainings),
        ):
            line |= {f"{what}: {title}": value for title, value in zip(scores.titles, values, strict=True)}
        rows.append(line)
    return lines(rows)


def comparisons_csv(comparisons: Sequence[Comparison]) -> str:
    """Return CSV with one row per pair of agents; '' without comparisons."""
    return lines(
        {
            "first": x.first,
            "second": x.second,
            "metric": x.metric,
            **_with_ends("difference", x.difference),
            "p": x.p_value,
            "p_holm": x.p_adjusted,
            "verdict": f"{x.verdict}*"
            if x.verdict != UNDECIDED and 0 < x.trainings < x.needed
            else x.verdict,
            "trainings": x.trainings or None,
            "enough": x.needed if x.trainings else None,
            **_not_behind("first_not_behind", x.first_reliability),
            **_not_behind("second_not_behind", x.second_reliability),
        }
        for x in comparisons
    )


def joined(column: str, parts: Sequence[tuple[str, str]]) -> str:
    """Join several named CSV texts into one CSV text.

    The first column of the result, `column`, has the name of the text that a row comes from. If a text lacks a
    column, this column is empty in the text's rows.
    """
    return lines(
        {column: name, **row} for name, text in parts for row in csv_module.DictReader(io.StringIO(text))
    )


def lines(rows: Iterable[Mapping[str, Any]]) -> str:
    """Return rows as CSV; '' without rows.

    Floats are written by repr, so that reading returns the same numbers. Missing values and NaN are empty cells.
    """
    entries = list(rows)
    if not entries:
        return ""
    buffer = io.StringIO()
    columns = list(dict.fromkeys(name for row in entries for name in row))
    writer = csv_module.DictWriter(buffer, columns, restval="", lineterminator="\n")
    writer.writeheader()
    for row in entries:
        # `cell` escapes a label that begins with =, which a spreadsheet would read as a formula.
        writer.writerow({name: "" if v is None or v != v else cell(v) for name, v in row.items()})
    return buffer.getvalue()


def escape(text: str) -> str:
    r"""Escape a text for a cell in Markdown.

    >>> print(escape("a|b_c<d>"))
    a\|b\_c&lt;d&gt;
    """
    return text.translate(_MARKDOWN)


def pipes(table: Table) -> str:
    """Return a table as a Markdown pipe table with its notes below it; intervals follow their values."""
    notes = _notes(table)
    if not table.lines:
        return notes
    rules = ["---" if heading.words else "---:" for heading in table.headings]
    headings = [escape(heading.text) for heading in table.headings]
    entries = ([escape(cell.text) for cell in line.cells] for line in table.lines)
    return "\n\n".join(filter(None, [rows([headings, rules, *entries]), notes]))


def _notes(table: Table) -> str:
    lines = [f"* {escape(note)}" for note in table.notes]
    shown, folded = lines[:SHOWN_NOTES], lines[SHOWN_NOTES:]
    if folded:
        inside = "\n".join(folded)
        shown += [
            "",
            f"<details><summary>{counted(len(folded), 'more note')}</summary>",
            "",
            inside,
            "",
            "</details>",
        ]
    return "\n".join(shown)


def rows(cells: Iterable[Iterable[str]]) -> str:
    """Return rows of cells (headings, rules, entries) as the lines of a Markdown pipe table."""
    return "\n".join("| " + " | ".join(row) + " |" for row in cells)


def markdown(ranking: Ranking, figure: str = "") -> str:
    """Return the headline, `figure` (Markdown), the main table, its notes and the list of problems."""
    return f"{answer(ranking, figure)}\n\n{details(ranking)}\n"


def answer(ranking: Ranking, figure: str = "") -> str:
    """Return the headline, `figure` (Markdown) and notices."""
    return "\n\n".join(
        [f"**{escape(headline(ranking))}**", *filter(None, [figure]), *map(escape, ranking.notices)]
    )


def details(ranking: Ranking) -> str:
    """Return the main table, its notes and the list of problems."""
    parts = [pipes(main_table(ranking))]
    for title, problems in grouped(ranking.problems):
        lines = [f"- {escape(p.where)}: {escape(p.message)}" for p in problems]
        parts.append("\n".join([f"**{capitalized(title)} ({len(problems)})**", "", *lines]))
    return "\n\n".join(parts)


def escape_latex(text: str) -> str:
    r"""Escape a text for LaTeX.

    >>> print(escape_latex("50 % of a_b & c"))
    50 \% of a\_b \& c
    """
    return "".join(_SPECIAL.get(character, character) for character in text)


def latex(ranking: Ranking) -> str:
    r"""Return the main table as LaTeX for `\input`.

    The document needs the packages booktabs, graphicx, and amssymb (for the verdicts' symbols), and the font
    encoding T1 (for `"` and `<`).
    """
    table = main_table(ranking)
    notes = [*ranking.notices, *table.notes]
    if n := len(ranking.problems):
        notes.append(f"Not in the table, or only in part: {counted(n, 'run')} (see report.md).")
    return in_print(replace(table, notes=tuple(notes)), "main")


def in_print(table: Table | None, label: str) -> str:
    r"""Return a table as LaTeX for `\input`, shrunk to the width of the text if needed; '' for None or without rows."""
    if table is None or not table.lines:
        return ""
    columns = "".join("l" if heading.words else "r" for heading in table.headings)
    lines = [
        HEAD,
        "",
        r"\begin{table}[htbp]",
        r"\centering",
        rf"\caption{{{escape_latex(table.title)}}}\label{{tab:auvbench-{label}}}",
        r"\resizebox{\ifdim\width>\linewidth\linewidth\else\width\fi}{!}{%",
        rf"\begin{{tabular}}{{@{{}}{columns}@{{}}}}",
        r"\toprule",
        " & ".join(map(_latex_heading, table.headings)) + r" \\",
        r"\midrule",
    ]
    for line in table.lines:
        # LaTeX would read a bracket at the start of a row as the optional argument of the preceding \\.
        lines.append(" & ".join(escape_latex(cell.value) for cell in line.cells) + r" \\[-2pt]")
        lines.append(" & ".join(map(_latex_more, line.cells)) + r" \\[1.5pt]")
    lines.append(r"\bottomrule\end{tabular}}")
    if table.notes:
        below = escape_latex(" ".join(table.notes[:SHOWN_NOTES]))
        lines += ["", r"\medskip", rf"\parbox{{\linewidth}}{{\scriptsize {below}}}"]
    lines += [f"% {escape_latex(note)}" for note in table.notes[SHOWN_NOTES:]]
    return "\n".join([*lines, r"\end{table}", ""])


def _latex_more(cell: Cell) -> str:
    return rf"{{\tiny {escape_latex(cell.more)}}}" if cell.more else ""


def _latex_heading(heading: Heading) -> str:
    """Return the heading with its unit on a second line, so that the heading is not wider than the column's intervals."""
    title = heading.tex or escape_latex(heading.title)
    return rf"\shortstack{{{title}\\({escape_latex(heading.unit)})}}" if heading.unit else title

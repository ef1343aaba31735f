"""The table for a paper: booktabs, intervals under the values, as many tables as fit the width of an article."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from auvbench.analysis.model import Ranking
from auvbench.reporting.tables import columns as c
from auvbench.reporting.tables.notes import grouped, notes

ROWS_PER_FLOAT = 25
"""a float does not break across pages, so a long ranking continues in another one"""

HEAD = r"% \usepackage{booktabs} \usepackage[T1]{fontenc} \usepackage[utf8]{inputenc}"

TEXT_WIDTH = 345.0
"""points; that of \\documentclass{article}, the narrowest of the usual ones in one column"""

MOST_PROBLEMS = 12
"""under a table in print; report.md lists all"""

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
}


def escape(text: str) -> str:
    r"""Text that LaTeX sets literally.

    >>> print(escape("50 % of a_b & c"))
    50 \% of a\_b \& c
    """
    return "".join(_SPECIAL.get(character, character) for character in text)


def latex(ranking: Ranking) -> str:
    r"""Tables to `\input`: where episodes end, then motion and effort. Needs booktabs, and T1 for `"` and `<`."""
    outcome = (*c.extra(ranking), *c.present(c.OUTCOMES, ranking))
    motion = c.present(c.MOTION, ranking)
    lead = c.lead(ranking)
    caption = f"Agents ranked by {escape(ranking.rank_by)} on protocol {escape(ranking.protocol)}"
    tables: list[str] = []
    for shown, title, label in (
        (outcome, f"{caption}.", "outcomes"),
        (motion, f"{caption}: motion and effort.", "motion"),
    ):
        for i, part in enumerate(fitting(ranking, lead, shown)):
            more = f"-{chr(ord('a') + i)}" if i else ""
            title_ = f"{title} Further columns." if i else title
            tables += floats(ranking, lead, part, title_, label + more, full=not tables)
    return "\n\n".join([HEAD, *tables]) + "\n"


def fitting(ranking: Ranking, lead: Sequence[str], columns: Sequence[c.Column]) -> list[list[c.Column]]:
    """The columns in parts that stand beside the lead within `TEXT_WIDTH`; one column at least in each."""
    marked = c.policies(ranking)
    cells = [c.lead_cells(row, lead, marked) for row in ranking.rows]
    room = TEXT_WIDTH - sum(6.0 + max(map(_points, texts)) for texts in zip(lead, *cells, strict=True))
    parts: list[list[c.Column]] = []
    left = 0.0
    for column in columns:
        values, intervals = zip(*(c.cell(row, column) for row in ranking.rows), strict=True)
        heading = re.sub(r"\\[a-zA-Z]+|\\.", "x", column.tex).replace("$", "")
        headings = heading.replace(" (", "\n(").split("\n")
        width = 6.0 + max(*map(_points, (*headings, *values)), *(0.85 * _points(text) for text in intervals))
        if not parts or width > left:
            parts.append([])
            left = room
        parts[-1].append(column)
        left -= width
    return parts


def _points(text: str) -> float:
    r"""Width in \scriptsize Computer Modern, on the long side; \tiny is 0.85 of it."""
    narrow, wide = " .,:[]()ijlft", "=<>@%+mw"
    return sum(3.0 if x in narrow else 6.0 if x.isupper() or x in wide else 4.1 for x in text)


def floats(
    ranking: Ranking,
    lead: Sequence[str],
    shown: Sequence[c.Column],
    caption: str,
    label: str,
    *,
    full: bool = False,
) -> list[str]:
    """The rows in tables of at most `ROWS_PER_FLOAT`; with `full`, the note stands below the first."""
    rows, marked = ranking.rows, c.policies(ranking)
    chunks = [rows[i : i + ROWS_PER_FLOAT] for i in range(0, len(rows), ROWS_PER_FLOAT)] or [()]
    result = []
    for i, chunk in enumerate(chunks):
        continued = " (continued)" if i else ""
        name = f"tab:auvbench-{label}" + (f"-{i + 1}" if i else "")
        below = _below(ranking) if full and not i else ""
        result.append(
            _float(replace(ranking, rows=chunk), marked, lead, shown, caption + continued, name, below)
        )
    return result


def _float(
    ranking: Ranking,
    marked: frozenset[str],
    lead: Sequence[str],
    shown: Sequence[c.Column],
    caption: str,
    label: str,
    below: str,
) -> str:
    headings = [*lead, *(_split_heading(column.tex) for column in shown)]
    lines = [
        r"\begin{table}[htbp]",
        r"\centering\scriptsize\setlength{\tabcolsep}{3pt}",
        rf"\caption{{{caption}}}\label{{{label}}}",
        rf"\begin{{tabular}}{{@{{}}{''.join('r' if name == 'seeds' else 'l' for name in lead)}{'r' * len(shown)}@{{}}}}",
        r"\toprule",
        " & ".join(headings) + r" \\",
        r"\midrule",
    ]
    for row in ranking.rows:
        cells = [c.cell(row, column) for column in shown]
        values = [escape(text) for text in (*c.lead_cells(row, lead, marked), *(v for v, _ in cells))]
        # A bracket at the start of a row would be read as the optional argument of the \\ above it.
        intervals = [*("" for _ in lead), *(rf"{{\tiny {escape(i)}}}" if i else "" for _, i in cells)]
        lines += [" & ".join(values) + r" \\[-2pt]", " & ".join(intervals) + r" \\[1.5pt]"]
    lines += [r"\bottomrule", r"\end{tabular}"]
    if below:
        lines += ["", r"\medskip", rf"\parbox{{\linewidth}}{{{below}}}"]
    return "\n".join([*lines, r"\end{table}"])


def _split_heading(tex: str) -> str:
    """The unit under the title, so that a column is no wider than its interval."""
    title, bracket, unit = tex.partition(" (")
    return rf"\shortstack{{{title}\\({unit}}}" if bracket else tex


def _below(ranking: Ranking) -> str:
    text = [escape(line) for line in (*ranking.notices, *notes(ranking))]
    listed = [(title, problem) for title, problems in grouped(ranking.problems) for problem in problems]
    if listed:
        shown = "; ".join(f"{escape(p.where)} ({escape(title)})" for title, p in listed[:MOST_PROBLEMS])
        more = f"; and {len(listed) - MOST_PROBLEMS} more" if len(listed) > MOST_PROBLEMS else ""
        text.append(f"Not in the table, or only in part: {shown}{more}.")
    return " ".join(text)

"""The table for a paper: booktabs, intervals under the values, two tables so that each fits a page's width."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from auvbench.reporting.model import Ranking
from auvbench.reporting.tables import columns as c
from auvbench.reporting.tables.notes import grouped, notes

ROWS_PER_FLOAT = 25
"""a float does not break across pages, so a long ranking continues in another one"""

HEAD = r"% \usepackage{booktabs} \usepackage[T1]{fontenc} \usepackage[utf8]{inputenc}"

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
    tables = floats(ranking, lead, outcome, f"{caption}.", "outcomes", full=True)
    if motion:
        tables += floats(ranking, lead, motion, f"{caption}: motion and effort.", "motion")
    return "\n\n".join([HEAD, *tables]) + "\n"


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
    rows, marked = ranking.rows, c.one_seed_among_many(ranking)
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
    text = [escape(line) for line in notes(ranking)]
    listed = [(title, problem) for title, problems in grouped(ranking.problems) for problem in problems]
    if listed:
        shown = "; ".join(f"{escape(p.where)} ({escape(title)})" for title, p in listed[:MOST_PROBLEMS])
        more = f"; and {len(listed) - MOST_PROBLEMS} more" if len(listed) > MOST_PROBLEMS else ""
        text.append(f"Not in the table, or only in part: {shown}{more}.")
    return " ".join(text)

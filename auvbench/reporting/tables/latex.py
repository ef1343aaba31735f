"""The table for a paper: booktabs, intervals under the values, two tables so that each fits a page's width."""

from __future__ import annotations

from collections.abc import Sequence

from auvbench.reporting.model import Ranking, Row
from auvbench.reporting.tables import columns as c
from auvbench.reporting.tables.notes import grouped, notes

ROWS_PER_FLOAT = 25
"""a float does not break across pages, so a long ranking continues in another one"""

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
    lead = f"Agents ranked by {escape(ranking.rank_by)} on protocol {escape(ranking.protocol)}"
    floats = _floats(ranking, outcome, f"{lead}.", "outcomes", full=True)
    if motion:
        floats += _floats(ranking, motion, f"{lead}: motion and effort.", "motion", full=False)
    head = r"% \usepackage{booktabs} \usepackage[T1]{fontenc} \usepackage[utf8]{inputenc}"
    return "\n\n".join([head, *floats]) + "\n"


def _floats(
    ranking: Ranking, shown: Sequence[c.Column], caption: str, label: str, *, full: bool
) -> list[str]:
    rows = ranking.rows
    chunks = [rows[i : i + ROWS_PER_FLOAT] for i in range(0, len(rows), ROWS_PER_FLOAT)] or [()]
    result = []
    for i, chunk in enumerate(chunks):
        continued = " (continued)" if i else ""
        name = f"tab:auvbench-{label}" + (f"-{i + 1}" if i else "")
        result.append(_float(ranking, chunk, shown, caption + continued, name, full=full and not i))
    return result


def _float(
    ranking: Ranking, rows: Sequence[Row], shown: Sequence[c.Column], caption: str, label: str, *, full: bool
) -> str:
    marked = c.one_seed_among_many(ranking)
    lead = c.lead(ranking)
    headings = [*lead, *(_split_heading(column.tex) for column in shown)]
    lines = [
        r"\begin{table}[htbp]",
        r"\centering\scriptsize\setlength{\tabcolsep}{3pt}",
        rf"\caption{{{caption}}}\label{{{label}}}",
        rf"\begin{{tabular}}{{@{{}}{'l' * (len(lead) - 1)}r{'r' * len(shown)}@{{}}}}",
        r"\toprule",
        " & ".join(headings) + r" \\",
        r"\midrule",
    ]
    for row in rows:
        name = escape(row.label + (f" {c.DAGGER}" if row.label in marked else ""))
        cells = [c.cell(row, column) for column in shown]
        group = [escape(row.group)] if "group" in lead else []
        values = [escape(c.rank(row)), *group, name, c.seeds(row), *(escape(v) for v, _ in cells)]
        # A bracket at the start of a row would be read as the optional argument of the \\ above it.
        intervals = [*("" for _ in lead), *(rf"{{\tiny {escape(i)}}}" if i else "" for _, i in cells)]
        lines += [" & ".join(values) + r" \\[-2pt]", " & ".join(intervals) + r" \\[1.5pt]"]
    lines += [r"\bottomrule", r"\end{tabular}"]
    if full:
        lines += ["", r"\medskip", rf"\parbox{{\linewidth}}{{{_below(ranking)}}}"]
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

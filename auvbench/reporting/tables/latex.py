"""Tables for a paper: booktabs, intervals under the values, as many tables as fit the width of an article."""

from __future__ import annotations

import re
from dataclasses import replace

from auvbench.analysis.aggregate import Across
from auvbench.analysis.formatting import name
from auvbench.analysis.measures import measure
from auvbench.analysis.records import Ranking
from auvbench.reporting.tables.appendix import across_notes, across_table, conditions_note, conditions_table
from auvbench.reporting.tables.main import main_table
from auvbench.reporting.tables.notes import grouped, notes
from auvbench.reporting.tables.table import Cell, Heading, Table, split

ROWS_PER_FLOAT = 25
"""a float does not break across pages, so a long table continues in another one"""

HEAD = r"% \usepackage{booktabs} \usepackage{amssymb} \usepackage[T1]{fontenc} \usepackage[utf8]{inputenc}"

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
    "±": r"$\pm$",
    "▲": r"$\blacktriangle$",
    "■": r"$\blacksquare$",
    "▼": r"$\blacktriangledown$",
    "○": r"$\circ$",
}


def escape(text: str) -> str:
    r"""Text that LaTeX sets literally.

    >>> print(escape("50 % of a_b & c"))
    50 \% of a\_b \& c
    """
    return "".join(_SPECIAL.get(character, character) for character in text)


def latex(ranking: Ranking) -> str:
    r"""Return the main table to `\input`. Needs booktabs, amssymb for the verdicts' symbols, and T1 for `"` and `<`."""
    by = name(measure(ranking.rank_by))
    against = f" against {ranking.primary.baseline}" if ranking.primary else ""
    caption = f"Agents{against} in {by} on protocol {ranking.protocol}."
    return _document(main_table(ranking), caption, "main", _below(ranking))


def conditions_latex(ranking: Ranking) -> str:
    r"""Return success by condition to `\input`; an empty string where the protocol has only one."""
    if not ranking.conditions:
        return ""
    return _document(conditions_table(ranking), conditions_note(ranking), "conditions")


def across_latex(table: Across) -> str:
    r"""Return the agents over all tasks to `\input`."""
    return _document(across_table(table), " ".join(across_notes(table)), "across")


def _document(table: Table, caption: str, label: str, below: str = "") -> str:
    return "\n\n".join([HEAD, *floats(table, caption, label, below)]) + "\n"


def floats(table: Table, caption: str, label: str, below: str = "") -> list[str]:
    """Return the table in floats of at most `TEXT_WIDTH` and `ROWS_PER_FLOAT`; the note stands below the first."""
    result: list[str] = []
    for part in split(table, lambda i: _width(table, i), TEXT_WIDTH):
        shown = table.part(part)
        starts = range(0, max(len(shown.lines), 1), ROWS_PER_FLOAT)
        for chunk in (replace(shown, lines=shown.lines[i : i + ROWS_PER_FLOAT]) for i in starts):
            title = f"{caption} (continued)" if result else caption
            mark = f"-{len(result) + 1}" if result else ""
            result.append(
                _float(chunk, escape(title), f"tab:auvbench-{label}{mark}", "" if result else below)
            )
    return result


def _width(table: Table, i: int) -> float:
    """Return the points that a column takes, with its padding."""
    cells = [line.cells[i] for line in table.lines]
    heading = table.headings[i]
    title = re.sub(r"\\[a-zA-Z]+|\\.", "x", heading.tex or heading.title).replace("$", "")
    widths = [_points(title), _points(f"({heading.unit})")]
    widths += [_points(cell.value) for cell in cells] + [0.85 * _points(cell.more) for cell in cells]
    return 6.0 + max(widths)


def _points(text: str) -> float:
    r"""Return the width in \scriptsize Computer Modern, on the long side; \tiny is 0.85 of it."""
    narrow, wide = " .,:[]()ijlft", "=<>@%+mw▲■▼○"
    return sum(3.0 if x in narrow else 6.0 if x.isupper() or x in wide else 4.1 for x in text)


def _float(table: Table, caption: str, label: str, below: str) -> str:
    lines = [
        r"\begin{table}[htbp]",
        r"\centering\scriptsize\setlength{\tabcolsep}{3pt}",
        rf"\caption{{{caption}}}\label{{{label}}}",
        rf"\begin{{tabular}}{{@{{}}{''.join('l' if h.words else 'r' for h in table.headings)}@{{}}}}",
        r"\toprule",
        " & ".join(map(_heading, table.headings)) + r" \\",
        r"\midrule",
    ]
    for line in table.lines:
        # A bracket at the start of a row would be read as the optional argument of the \\ above it.
        lines.append(" & ".join(escape(cell.value) for cell in line.cells) + r" \\[-2pt]")
        lines.append(" & ".join(map(_more, line.cells)) + r" \\[1.5pt]")
    lines += [r"\bottomrule", r"\end{tabular}"]
    if below:
        lines += ["", r"\medskip", rf"\parbox{{\linewidth}}{{{below}}}"]
    return "\n".join([*lines, r"\end{table}"])


def _more(cell: Cell) -> str:
    return rf"{{\tiny {escape(cell.more)}}}" if cell.more else ""


def _heading(heading: Heading) -> str:
    """Return the heading, its unit below it, so that a column is no wider than its interval."""
    title = heading.tex or escape(heading.title)
    return rf"\shortstack{{{title}\\({escape(heading.unit)})}}" if heading.unit else title


def _below(ranking: Ranking) -> str:
    text = [escape(line) for line in (*ranking.notices, *notes(ranking))]
    listed = [(title, problem) for title, problems in grouped(ranking.problems) for problem in problems]
    if listed:
        shown = "; ".join(f"{escape(p.where)} ({escape(title)})" for title, p in listed[:MOST_PROBLEMS])
        more = f"; and {len(listed) - MOST_PROBLEMS} more" if len(listed) > MOST_PROBLEMS else ""
        text.append(f"Not in the table, or only in part: {shown}{more}.")
    return " ".join(text)

"""Tables for a paper: booktabs, intervals under the values, scaled to the width of the text."""

from __future__ import annotations

from dataclasses import replace

from auvbench.analysis.formatting import counted
from auvbench.analysis.records import Ranking
from auvbench.reporting.tables.main import main_table
from auvbench.reporting.tables.table import Cell, Heading, Table

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


def escape(text: str) -> str:
    r"""Text that LaTeX sets literally.

    >>> print(escape("50 % of a_b & c"))
    50 \% of a\_b \& c
    """
    return "".join(_SPECIAL.get(character, character) for character in text)


def latex(ranking: Ranking) -> str:
    r"""Return the main table to `\input`. Needs booktabs, graphicx, amssymb for the verdicts' symbols, and T1 for `"` and `<`."""
    table = main_table(ranking)
    notes = [*ranking.notices, *table.notes]
    if n := len(ranking.problems):
        notes.append(f"Not in the table, or only in part: {counted(n, 'run')} (see report.md).")
    return in_print(replace(table, notes=tuple(notes)), "main")


def in_print(table: Table | None, label: str) -> str:
    r"""Return a table to `\input`, scaled to the width of the text where it is wider; empty for none, or one without rows."""
    if table is None or not table.lines:
        return ""
    columns = "".join("l" if heading.words else "r" for heading in table.headings)
    lines = [
        HEAD,
        "",
        r"\begin{table}[htbp]",
        r"\centering",
        rf"\caption{{{escape(table.title)}}}\label{{tab:auvbench-{label}}}",
        r"\resizebox{\ifdim\width>\linewidth\linewidth\else\width\fi}{!}{%",
        rf"\begin{{tabular}}{{@{{}}{columns}@{{}}}}",
        r"\toprule",
        " & ".join(map(_heading, table.headings)) + r" \\",
        r"\midrule",
    ]
    for line in table.lines:
        # A bracket at the start of a row would be read as the optional argument of the \\ above it.
        lines.append(" & ".join(escape(cell.value) for cell in line.cells) + r" \\[-2pt]")
        lines.append(" & ".join(map(_more, line.cells)) + r" \\[1.5pt]")
    lines.append(r"\bottomrule\end{tabular}}")
    if table.notes:
        below = escape(" ".join(table.notes))
        lines += ["", r"\medskip", rf"\parbox{{\linewidth}}{{\scriptsize {below}}}"]
    return "\n".join([*lines, r"\end{table}", ""])


def _more(cell: Cell) -> str:
    return rf"{{\tiny {escape(cell.more)}}}" if cell.more else ""


def _heading(heading: Heading) -> str:
    """Return the heading, its unit below it, so that a column is no wider than its interval."""
    title = heading.tex or escape(heading.title)
    return rf"\shortstack{{{title}\\({escape(heading.unit)})}}" if heading.unit else title

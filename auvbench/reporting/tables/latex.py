"""Tables for a paper: booktabs, intervals under the values, scaled to the width of the text."""

from __future__ import annotations

from auvbench.analysis.formatting import counted, name
from auvbench.analysis.measures import measure
from auvbench.analysis.records import Ranking
from auvbench.analysis.score import Scores
from auvbench.reporting.tables.appendix import conditions_note, conditions_table, score_notes, score_table
from auvbench.reporting.tables.main import main_table
from auvbench.reporting.tables.notes import notes
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
    by = name(measure(ranking.rank_by))
    against = f" against {ranking.primary.baseline}" if ranking.primary else ""
    caption = f"Agents{against} in {by} on protocol {ranking.protocol}."
    return _document(main_table(ranking), caption, "main", _below(ranking))


def conditions_latex(ranking: Ranking) -> str:
    r"""Return success by condition to `\input`; an empty string where the protocol has only one."""
    if not ranking.conditions:
        return ""
    return _document(conditions_table(ranking), conditions_note(ranking), "conditions")


def score_latex(found: Scores) -> str:
    r"""Return the score across tasks to `\input`; an empty string without a score."""
    return _document(score_table(found), " ".join(score_notes(found)), "score") if found.rows else ""


def _document(table: Table, caption: str, label: str, below: str = "") -> str:
    return f"{HEAD}\n\n{_table(table, caption, f'tab:auvbench-{label}', below)}\n"


def _table(table: Table, caption: str, label: str, below: str) -> str:
    """Return one table; one that is wider than the text is scaled to its width."""
    columns = "".join("l" if heading.words else "r" for heading in table.headings)
    lines = [
        r"\begin{table}[htbp]",
        r"\centering",
        rf"\caption{{{escape(caption)}}}\label{{{label}}}",
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
    if below:
        lines += ["", r"\medskip", rf"\parbox{{\linewidth}}{{\scriptsize {below}}}"]
    return "\n".join([*lines, r"\end{table}"])


def _more(cell: Cell) -> str:
    return rf"{{\tiny {escape(cell.more)}}}" if cell.more else ""


def _heading(heading: Heading) -> str:
    """Return the heading, its unit below it, so that a column is no wider than its interval."""
    title = heading.tex or escape(heading.title)
    return rf"\shortstack{{{title}\\({escape(heading.unit)})}}" if heading.unit else title


def _below(ranking: Ranking) -> str:
    text = [*ranking.notices, *notes(ranking)]
    if ranking.problems:
        text.append(
            f"Not in the table, or only in part: {counted(len(ranking.problems), 'run')} (see report.md)."
        )
    return escape(" ".join(text))

"""The tables of a report in every format. Each function draws what a `Ranking` holds and computes nothing."""

from auvbench.reporting.tables.latex import conditions_latex, latex, score_latex
from auvbench.reporting.tables.terminal import (
    claims_terminal,
    comparison_terminal,
    conditions_terminal,
    findings_terminal,
    score_terminal,
    terminal,
)
from auvbench.reporting.tables.text_formats import (
    comparison_markdown,
    comparisons_csv,
    conditions_csv,
    conditions_markdown,
    csv,
    joined,
    markdown,
    ranks_markdown,
    score_csv,
    score_markdown,
)

__all__ = [
    "claims_terminal",
    "comparison_markdown",
    "comparison_terminal",
    "comparisons_csv",
    "conditions_csv",
    "conditions_latex",
    "conditions_markdown",
    "conditions_terminal",
    "csv",
    "findings_terminal",
    "joined",
    "latex",
    "markdown",
    "ranks_markdown",
    "score_csv",
    "score_latex",
    "score_markdown",
    "score_terminal",
    "terminal",
]

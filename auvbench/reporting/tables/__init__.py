"""The ranked table in four shapes. Each function draws what a `Ranking` holds and computes nothing."""

from auvbench.reporting.tables.across import (
    across_csv,
    across_latex,
    across_markdown,
    across_terminal,
)
from auvbench.reporting.tables.beside import beside_terminal
from auvbench.reporting.tables.comma import comparisons_csv, conditions_csv, csv, limit_csv
from auvbench.reporting.tables.conditions import conditions_latex
from auvbench.reporting.tables.latex import latex
from auvbench.reporting.tables.markdown import comparisons_markdown, conditions_markdown, markdown
from auvbench.reporting.tables.terminal import (
    comparisons_terminal,
    conditions_terminal,
    findings_terminal,
    terminal,
)

__all__ = [
    "across_csv",
    "across_latex",
    "across_markdown",
    "across_terminal",
    "beside_terminal",
    "comparisons_csv",
    "comparisons_markdown",
    "comparisons_terminal",
    "conditions_csv",
    "conditions_latex",
    "conditions_markdown",
    "conditions_terminal",
    "csv",
    "findings_terminal",
    "latex",
    "limit_csv",
    "markdown",
    "terminal",
]

"""The ranked table in four shapes. Each function draws what a `Ranking` holds and computes nothing."""

from auvbench.reporting.tables.beside import beside_terminal
from auvbench.reporting.tables.comma import comparisons_csv, conditions_csv, csv
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
    "markdown",
    "terminal",
]

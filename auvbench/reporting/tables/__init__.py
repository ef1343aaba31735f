"""The tables of a report in every format. Each function draws what a `Ranking` holds and computes nothing."""

from auvbench.reporting.tables.aggregate import (
    across_csv,
    across_latex,
    across_markdown,
    across_table,
    across_terminal,
)
from auvbench.reporting.tables.csv import comparisons_csv, conditions_csv, csv, joined, limit_csv
from auvbench.reporting.tables.latex import conditions_latex, latex
from auvbench.reporting.tables.main import main_table
from auvbench.reporting.tables.markdown import conditions_markdown, markdown, ranks_markdown
from auvbench.reporting.tables.terminal import (
    appendix_terminal,
    claims_terminal,
    conditions_terminal,
    findings_terminal,
    terminal,
)
from auvbench.reporting.tables.thesis_comparison import comparison_terminal

__all__ = [
    "across_csv",
    "across_latex",
    "across_markdown",
    "across_table",
    "across_terminal",
    "appendix_terminal",
    "claims_terminal",
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
    "limit_csv",
    "main_table",
    "markdown",
    "ranks_markdown",
    "terminal",
]

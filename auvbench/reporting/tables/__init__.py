"""Build the tables of a report in every format; `analysis` computes the numbers."""

from auvbench.reporting.tables.appendix import comparison_table, conditions_tables, ranks_table, score_table
from auvbench.reporting.tables.by_condition import by_condition_tables
from auvbench.reporting.tables.terminal import TableView, findings_terminal, terminal
from auvbench.reporting.tables.text_formats import (
    answer,
    by_condition_csv,
    comparisons_csv,
    conditions_csv,
    csv,
    details,
    in_print,
    joined,
    latex,
    markdown,
    pipes,
    score_csv,
)

__all__ = [
    "TableView",
    "answer",
    "by_condition_csv",
    "by_condition_tables",
    "comparison_table",
    "comparisons_csv",
    "conditions_csv",
    "conditions_tables",
    "csv",
    "details",
    "findings_terminal",
    "in_print",
    "joined",
    "latex",
    "markdown",
    "pipes",
    "ranks_table",
    "score_csv",
    "score_table",
    "terminal",
]

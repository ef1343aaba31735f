"""Show a report on a terminal."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from auvbench.analysis.by_condition import Subject
    from auvbench.analysis.options import Options
    from auvbench.analysis.records import Report
    from auvbench.analysis.score import Scores


def show(report: Report, options: Options) -> None:
    """Print the tables, findings and claims of one section."""
    from rich.console import Console
    from rich.markdown import Markdown
    from rich.text import Text

    from auvbench.reporting import tables
    from auvbench.reporting.write import claims_in_markdown

    if "terminal" not in options.format:
        return
    console = Console(highlight=False)
    console.print(tables.terminal(report.ranking))
    for conditions in tables.conditions_tables(report.ranking):
        console.print(Text(f"\n{conditions.title}", style="bold"))
        console.print(tables.TableView(conditions))
    if report.findings:
        console.print(Text("\nfindings", style="bold"))
        console.print(tables.findings_terminal(report.findings))
    if report.claims:
        console.print(Text("\nclaims of the study", style="bold"))
        console.print(Markdown(claims_in_markdown(report.claims)))
    if comparison := tables.comparison_table(report.comparison):
        console.print(Text(f"\n{comparison.title}", style="bold"))
        console.print(tables.TableView(comparison))


def show_score(score: Scores | None, options: Options) -> None:
    """Print the table across tasks, if there are several tasks."""
    from rich.console import Console

    from auvbench.reporting import tables

    if score is not None and "terminal" in options.format:
        heading("score across tasks")
        Console(highlight=False).print(tables.TableView(tables.score_table(score)))


def show_by_condition(subjects: Sequence[Subject], options: Options) -> None:
    """Print tables of the leading agent under each condition, and of all differences from the baseline."""
    from rich.console import Console

    from auvbench.reporting import tables

    if "terminal" in options.format:
        for table in tables.by_condition_tables(subjects):
            heading(table.title)
            Console(highlight=False).print(tables.TableView(table))


def heading(title: str) -> None:
    """Print a heading between the sections of a report on a terminal."""
    from rich.console import Console
    from rich.rule import Rule
    from rich.text import Text

    console = Console(highlight=False)
    console.print()
    console.print(Rule(Text(title, style="bold"), align="left"))


def say_written(written: Sequence[Path]) -> None:
    """Print the path of each written file, one per line."""
    from rich.console import Console
    from rich.text import Text

    console = Console(highlight=False)
    if written:
        console.print()
    for path in written:
        console.print(Text.assemble(("wrote ", "dim"), os.path.relpath(path)), soft_wrap=True)

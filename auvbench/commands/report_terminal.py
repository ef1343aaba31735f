"""What `auvbench report` shows on a terminal."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from auvbench.analysis.score import Scores
    from auvbench.commands.report import Report
    from auvbench.commands.report_options import Options


def show(report: Report, options: Options) -> None:
    """The tables of one section, its findings and claims."""
    from rich.console import Console
    from rich.text import Text

    from auvbench.reporting import tables

    if "terminal" not in options.format:
        return
    console = Console(highlight=False)
    console.print(tables.terminal(report.ranking))
    if report.ranking.conditions:
        console.print()
        console.print(tables.conditions_terminal(report.ranking))
    if report.findings:
        console.print(Text("\nfindings", style="bold"))
        console.print(tables.findings_terminal(report.findings, all_of_them=options.all_findings))
    if report.claims:
        console.print(Text("\nclaims of the study", style="bold"))
        console.print(tables.claims_terminal(report.claims))
    if report.comparison:
        console.print()
        console.print(tables.comparison_terminal(report.comparison))
    if options.pairs:
        console.print()
        console.print(tables.appendix_terminal(report.ranking))


def show_score(score: Scores | None, options: Options) -> None:
    """The table across tasks, where there are several."""
    from rich.console import Console

    from auvbench.reporting import tables

    if score is not None and "terminal" in options.format:
        heading("score across tasks")
        Console(highlight=False).print(tables.score_terminal(score))


def heading(title: str) -> None:
    """Parts the sections of a report on a terminal."""
    from rich.console import Console
    from rich.rule import Rule
    from rich.text import Text

    console = Console(highlight=False)
    console.print()
    console.print(Rule(Text(title, style="bold"), align="left"))


def say_written(written: Sequence[Path]) -> None:
    """The files, a line each."""
    from rich.console import Console
    from rich.text import Text

    console = Console(highlight=False)
    if written:
        console.print()
    for path in written:
        console.print(Text.assemble(("wrote ", "dim"), os.path.relpath(path)), soft_wrap=True)

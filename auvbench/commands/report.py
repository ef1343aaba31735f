"""`auvbench report`: rank runs and write tables, figures and a page."""

from __future__ import annotations

import gc
import os
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from auvbench.commands.report_options import parser, read
from auvbench.untrusted import path_safety

if TYPE_CHECKING:
    from auvbench.analysis.options import Options


def main(argv: Sequence[str]) -> int:
    """Write the report and return 0. Runs that cannot be in the report are named and left out."""
    paths, options, _ = read(parser(), argv)
    # Garbage collection would take a sixth of the time and free little: nearly all of a report's millions of objects stay in use.
    gc.disable()
    try:
        _report(paths, options, shlex.join(["auvbench", "report", *argv]))
    finally:
        gc.enable()
    return 0


def _report(paths: Sequence[Path], options: Options, command: str) -> None:
    from auvbench.analysis.analyse import across_tasks, analyse
    from auvbench.analysis.by_condition import compare, of_protocol
    from auvbench.commands import report_terminal as terminal
    from auvbench.reporting import folder
    from auvbench.runs.atomic_io import storage

    reports = analyse(paths, options)
    others = [of_protocol(options, name) for name in options.also if name != options.protocol]
    tested = [(options, reports), *((own, analyse(paths, own)) for own in others)]
    subjects = compare(tested) if options.also else []
    runs = [run for report in reports for run in report.runs]
    experiment = os.path.commonpath([run.directory.absolute().parent for run in runs])
    out = options.out or Path(experiment, "report")
    # Only the default folder is checked, since it may belong to another program. A folder that the user named may even be a link.
    if options.out is None:
        path_safety.check_output(out)
    path_safety.check_output(out / "figures")
    score = across_tasks(reports, options) if len(reports) > 1 else None
    with storage(f"cannot write the report into {out}"):
        if len(reports) == 1:
            report, written = folder.write(reports[0], options, command, out, subjects=subjects)
            for name in ("score.tex", "score.csv"):  # files that an earlier report with several tasks wrote
                (out / name).unlink(missing_ok=True)
            reports = [report]
        else:
            reports, written = folder.write_sections(reports, options, command, out, score, subjects)
    for report in reports:
        if len(reports) > 1:
            terminal.heading(report.section.title)
        terminal.show(report, options)
    terminal.show_score(score, options)
    terminal.show_by_condition(subjects, options)
    terminal.say_written(written)
    if options.log is not None:
        from auvbench import tracking
        from auvbench.reporting import tables

        rows = tables.joined("vehicle", [(r.section.vehicle, tables.csv(r.ranking)) for r in reports])
        tracking.table(options.log, command, rows, written)

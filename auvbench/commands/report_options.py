"""Read the options of `auvbench report` from conf/report.yaml, the declared analysis and the command line."""

from __future__ import annotations

import argparse
import os
import textwrap
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from auvbench import metrics
from auvbench.analysis.options import FORMATS, KEYS, STUDIES, Options, converted, named, settings
from auvbench.errors import ConfigError, closest
from auvbench.grammar import Parser, number
from auvbench.record import measure_names
from auvbench.registry import TRACKERS
from auvbench.runs import declared as analyses
from auvbench.runs.declared import Declared
from auvbench.untrusted.text import short


def read(parser: Parser, argv: Sequence[str]) -> tuple[list[Path], Options, dict[str, Any]]:
    """Return the paths, the options and the values of all flags.

    The options come from conf/report.yaml, the declared analysis and the command line; a later source overrides an earlier.
    """
    flags = vars(parser.read(argv))
    values = settings()
    declared, folder, undecided = _declared(flags["paths"])
    if declared is not None:
        values |= named(declared.report) | _set_by(declared)
    typed = {key: flags[key] for key in KEYS if flags.get(key) is not None}
    log = typed.get("log", values["log"])
    if log is not None and log not in TRACKERS.names():
        raise ConfigError(f"--log {short(str(log))}: unknown; {closest(str(log), TRACKERS.names())}")
    options = replace(
        converted(values | typed, typed),
        declared=declared,
        declared_in=folder,
        usual=converted(values),
        undecided=undecided,
    )
    return flags["paths"], options, flags


def _set_by(declared: Declared) -> dict[str, Any]:
    """Return the options that a declared analysis sets."""
    options = {"rank_by": declared.measure, "baseline": declared.baseline, "margin": declared.margin}
    if declared.names_runs:
        options |= {"protocol": declared.protocol, "condition": declared.conditions[0]}
    return options


def _declared(paths: Sequence[Path]) -> tuple[Declared | None, Path | None, str]:
    """Return the analysis that is declared for the runs, the folder of the declaration, and why no analysis is chosen ('' if one is).

    Several declarations are allowed if one of them extends all others, as the declaration of a published study extends that of
    its experiment. If no declaration extends all others, no analysis is chosen.
    """
    declarations = analyses.find(paths)
    if not declarations:
        return None, None, ""
    file, longest = max(declarations, key=lambda declaration: len(declaration[1].rows))
    if all(longest.extends(analysis) for _, analysis in declarations):
        return longest, file.parent, ""
    files = ", ".join(os.path.relpath(file) for file, _ in declarations[:3])
    return None, None, f"several analyses are declared ({files}): name one of their folders, or type options"


def measures() -> str:
    """Return a text with every measure of `--rank-by`, its unit and its meaning, one paragraph each."""
    lines = ["measures:"]
    for metric in metrics.registered():
        if metric.measure not in measure_names():
            continue
        unit = f", {metric.unit}" if metric.unit not in ("", "1") else ""
        tasks = f" ({', '.join(metric.tasks)})" if metric.tasks else ""
        text = f"{metric.definition}{unit}{tasks}; {metric.better} is better"
        lines += [
            f"  {metric.measure}",
            *textwrap.wrap(text, 100, initial_indent=" " * 6, subsequent_indent=" " * 6),
        ]
    return "\n".join(lines)


def parser() -> Parser:
    """Return the parser; each flag is a key of conf/report.yaml."""
    parser = Parser(
        prog="auvbench report",
        where=True,
        description="Ranks runs and writes tables, figures and a page next to them.\n"
        "Defaults: conf/report.yaml.",
        epilog=f"example:\n  auvbench report outputs/quickstart --baseline pid --format terminal,tex --out paper/\n\n{measures()}",
    )
    add = parser.add_argument
    add("paths", nargs="+", type=Path, metavar="PATH", help="run directories, or folders that contain them")
    add("--rank-by", metavar="METRIC", help="primary measure, from the list below")
    add(
        "--columns",
        metavar="NAME,...",
        help="more columns: time_over_best_known, training_cpu_s, or any measure",
    )
    add(
        "--baseline",
        metavar="AGENT",
        help="baseline, which all agents are compared with: pid, or a label such as 'SAC K=1 10 Hz'",
    )
    add("--protocol", metavar="NAME", help="protocol whose rows are reported: test, thesis, robustness")
    add("--condition", metavar="NAME", help="test condition within the protocol, e.g. nominal, current=0.5")
    add(
        "--also",
        metavar="NAME,...",
        help="more protocols, for a table of the leading agent under each condition of all protocols, e.g. robustness",
    )
    add("--format", metavar="NAME,...", help=",".join(FORMATS))
    add(
        "--figures",
        action=argparse.BooleanOptionalAction,
        default=None,
        help="draw the figures; the formats md and html include them",
    )
    add(
        "--log",
        metavar="SERVICE",
        help=f"also log the ranked table and the files to: {', '.join(TRACKERS.names())}",
    )
    add("--out", metavar="DIR", help="folder of the report; default <experiment>/report")
    add("--study", metavar="NAME", help=f"test the claims of a study: {', '.join(STUDIES)}")
    add(
        "--confidence",
        type=number(0.5, 0.999),
        metavar="P",
        help="confidence of every interval, between 0.5 and 0.999",
    )
    add(
        "--margin",
        type=number(analyses.SMALLEST, 1e12),
        metavar="M",
        help="smallest difference of interest, in the measure's unit; for a rate in percentage points",
    )
    return parser

"""Read the options of `auvbench report` from conf/report.yaml, the declared analysis and the command line."""

from __future__ import annotations

import argparse
import os
import textwrap
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from auvbench import metrics
from auvbench.commands.grammar import Parser, number
from auvbench.errors import ConfigError, UserError, closest
from auvbench.record import measure_names
from auvbench.registry import TRACKERS
from auvbench.runs import declared as analyses
from auvbench.runs.declared import Declared
from auvbench.untrusted import reading, typed_json
from auvbench.untrusted.text import short
from auvbench.untrusted.typed_json import Count, Name, Range

Format = Literal["terminal", "md", "tex", "csv", "html"]
Study = Literal["thesis"]
FORMATS, STUDIES = get_args(Format), get_args(Study)


@dataclass(frozen=True, slots=True)
class Options:
    """Options of a report: the keys of conf/report.yaml, which explains them."""

    rank_by: Name
    primary: dict[Name, Name]
    names: dict[Name, str]
    trials: dict[Name, Count]
    columns: tuple[Name, ...]
    baseline: Name | None
    protocol: Name
    condition: Name | None
    format: tuple[Format, ...]
    figures: bool
    log: Name | None
    study: Study | None
    confidence: Annotated[float, Range(0.5, 0.999)]
    margin: Annotated[float, Range(analyses.SMALLEST)] | None
    where: tuple[str, ...]
    out: Any = None
    """Path of the folder; None: the experiment's folder"""
    declared: Declared | None = None
    """Analysis declared for the runs"""
    declared_in: Path | None = None
    """Folder of the declared analysis"""
    usual: Options | None = None
    """Options before the command line's: the defaults and the declared analysis"""
    undecided: str = ""
    """Reason why none of several declared analyses is used"""


OF_THE_DECLARATION = ("declared", "declared_in", "usual", "undecided")
KEYS = tuple(field.name for field in fields(Options) if field.name not in OF_THE_DECLARATION)
LISTS = ("columns", "format")
"""options that may be typed as comma-separated lists"""

STORED = ("primary", "names", "trials", "columns", "protocol", "condition", "study", "confidence")
"""Options that a published study stores if they differ from conf/report.yaml"""
OF_THE_TABLE = tuple(name for name in STORED if name not in ("protocol", "condition"))
"""The same for a study whose declaration names the protocol and the conditions"""


def defaults() -> Options:
    """Return the options of conf/report.yaml."""
    return _options(_usual())


def read(parser: Parser, argv: Sequence[str]) -> tuple[list[Path], Options, dict[str, Any]]:
    """Return the paths, the options (conf/report.yaml, the declared analysis, the command line) and the
    values of all flags.
    """
    flags = vars(parser.read(argv))
    settings = _usual()
    declared, folder, undecided = _declared(flags["paths"])
    if declared is not None:
        settings |= _named(declared.report) | _set_by(declared)
    typed = {key: flags[key] for key in KEYS if flags.get(key) is not None}
    log = typed.get("log", settings["log"])
    if log is not None and log not in TRACKERS.names():
        raise ConfigError(f"--log {short(str(log))}: unknown; {closest(str(log), TRACKERS.names())}")
    options = replace(
        _options(settings | typed, typed),
        declared=declared,
        declared_in=folder,
        usual=_options(settings),
        undecided=undecided,
    )
    return flags["paths"], options, flags


def _set_by(declared: Declared) -> dict[str, Any]:
    """Return the options that a declared analysis sets."""
    options = {"rank_by": declared.measure, "baseline": declared.baseline, "margin": declared.margin}
    if declared.names_runs:
        options |= {"protocol": declared.protocol, "condition": declared.conditions[0]}
    return options


def _usual() -> dict[str, Any]:
    text = (resources.files("auvbench.conf") / "report.yaml").read_bytes()
    return _named(reading.yaml_value(text))


def _declared(paths: Sequence[Path]) -> tuple[Declared | None, Path | None, str]:
    """Return the analysis declared for the runs and its folder, or the reason why several declarations leave
    none.

    A published study and its experiment may have declarations that extend each other: the longest counts.
    """
    declarations = analyses.find(paths)
    if not declarations:
        return None, None, ""
    file, longest = max(declarations, key=lambda declaration: len(declaration[1].rows))
    if all(longest.extends(analysis) for _, analysis in declarations):
        return longest, file.parent, ""
    files = ", ".join(os.path.relpath(file) for file, _ in declarations[:3])
    return None, None, f"several analyses are declared ({files}): name the folder of one, or type its options"


def _flag(key: str) -> str:
    return f"--{key.replace('_', '-')}"


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
        help="smallest difference of interest, in the measure's unit: 2 is 2 points",
    )
    return parser


def _named(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return options by name; raise an error for an unknown name."""
    named = {str(key).replace("-", "_"): value for key, value in settings.items()}
    for key in named:
        if key not in KEYS:
            raise UserError(f"unknown option {key!r} of a report; {closest(key, KEYS)}")
    return named


def _options(settings: Mapping[str, Any], typed: Collection[str] = ()) -> Options:
    """Return options with the declared types and ranges; an error message names an option of `typed` as a flag."""
    values = {key: settings[key] for key in KEYS}
    for key in LISTS:
        if isinstance(values[key], str):
            values[key] = list(dict.fromkeys(name.strip() for name in values[key].split(",")))
    values["columns"] = values["columns"] or []
    for key in ("primary", "names", "trials"):
        values[key] = values[key] or {}
    try:
        options = typed_json.convert(values, Options)
    except ValueError as error:
        entry, _, reason = str(error).partition(" ")
        key = entry.partition("[")[0]  # an item of a list: format[0]
        raise UserError(f"{_flag(key)} {reason}" if key in typed else f"report: {error}") from error
    return replace(options, out=None if options.out is None else Path(str(options.out)))

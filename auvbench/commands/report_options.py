"""The options of `auvbench report`: conf/report.yaml, a preset, the command line."""

from __future__ import annotations

import argparse
import os
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from auvbench.commands.grammar import Parser
from auvbench.errors import UserError, closest
from auvbench.metrics import METRICS
from auvbench.record import measure_names
from auvbench.untrusted import documents, reading

if TYPE_CHECKING:
    from auvbench.runs.declared import Declared

FORMATS = ("terminal", "md", "tex", "csv", "html")
STUDIES = ("thesis",)
FAILED_TRAININGS = ("zero", "omit")


@dataclass(frozen=True, slots=True)
class Options:
    """The keys of conf/report.yaml, which explains them."""

    rank_by: str
    then: str
    group_by: tuple[str, ...]
    columns: tuple[str, ...]
    pairs: bool
    all_findings: bool
    baseline: str | None
    protocol: str
    condition: str | None
    format: tuple[str, ...]
    figures: bool
    out: Path | None
    study: str | None
    confidence: float
    margin: float | None
    failed_trainings: str
    seed: int
    where: tuple[str, ...]
    declared: Declared | None = None
    """the analysis that was declared for the runs"""
    instead: tuple[str, ...] = ()
    """options that differ from the declared analysis"""
    undecided: str = ""
    """why none of several declared analyses is used"""


DECLARED_AS = {"rank_by": "measure", "baseline": "baseline", "margin": "margin"}
"""options of a report that a declared analysis sets"""


STORED = (
    "then",
    "group_by",
    "columns",
    "protocol",
    "condition",
    "study",
    "confidence",
    "failed_trainings",
    "seed",
)
"""other options that a published study stores where they differ from conf/report.yaml"""


def defaults() -> Options:
    """Return the options of conf/report.yaml."""
    return _options(_usual())


def parse(argv: Sequence[str]) -> tuple[list[Path], Options]:
    """Return paths and options: conf/report.yaml, the declared analysis, the preset, the command line."""
    paths, options, _ = read(parser(), argv)
    return paths, options


def read(parser: Parser, argv: Sequence[str]) -> tuple[list[Path], Options, dict[str, Any]]:
    """As `parse`, for a command that takes report's flags and more: the values of all flags come third."""
    values = vars(parser.read(argv))
    given = dict(values)
    values["where"] = values["where"] or None
    paths = values.pop("paths")
    preset = values.pop("preset")
    settings = _usual()
    declared, undecided = _declared(paths)
    if declared is not None:
        settings |= _known(declared.report, "the declared analysis")
        settings |= {key: getattr(declared, name) for key, name in DECLARED_AS.items()}
    if preset is not None:
        settings |= _read_preset(preset)
    settings |= {key: value for key, value in values.items() if value is not None}
    options = _options(settings)
    instead = () if declared is None else _differing(options, declared)
    return paths, replace(options, declared=declared, instead=instead, undecided=undecided), given


def _usual() -> dict[str, Any]:
    return _read_preset(resources.files("auvbench.conf") / "report.yaml")


def _declared(paths: Sequence[Path]) -> tuple[Declared | None, str]:
    """Return the analysis declared for the runs, or why several leave none."""
    from auvbench.runs import declared

    found = declared.find(paths)
    if len({analysis.digest for _, analysis in found}) > 1:
        files = ", ".join(os.path.relpath(file) for file, _ in found[:3])
        return None, f"several analyses are declared ({files}): name one's folder, or its options"
    return (found[0][1], "") if found else (None, "")


def _differing(options: Options, declared: Declared) -> tuple[str, ...]:
    """Return the options that are not those of the declared analysis, as they are typed."""
    return tuple(
        f"--{key.replace('_', '-')} {getattr(options, key)}"
        for key, name in DECLARED_AS.items()
        if getattr(options, key) != getattr(declared, name)
    )


def measures() -> str:
    """Return every measure of `--rank-by` with its unit and meaning, a paragraph each."""
    lines = ["measures:"]
    for metric in METRICS:
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
    """The flags, each a key of conf/report.yaml."""
    parser = Parser(
        prog="auvbench report",
        where=True,
        description="Ranks runs and writes tables, figures and a page next to them.\n"
        "Defaults: conf/report.yaml; --preset FILE holds your own.",
        epilog=f"example:\n  auvbench report outputs/quickstart --baseline pid --format terminal,tex --out paper/\n\n{measures()}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("paths", nargs="+", type=Path, metavar="PATH", help="run directories, or folders above them")
    add("--preset", type=Path, metavar="FILE", help="a YAML file of these options (rank_by: mean_steps)")
    add("--rank-by", metavar="METRIC", help="primary measure, one of those below")
    add("--then", metavar="METRIC", help="measure that decides between equals")
    add("--group-by", metavar="KEY,...", help="configuration keys whose values make a row: algo,reward.k")
    add(
        "--columns",
        metavar="NAME,...",
        help="further columns: time_over_best_known, training_cpu_s, or any measure",
    )
    add("--pairs", action=argparse.BooleanOptionalAction, default=None, help="show ranks and all pairs")
    add(
        "--all-findings",
        action=argparse.BooleanOptionalAction,
        default=None,
        help="show all findings, not the first five",
    )
    add(
        "--baseline",
        metavar="AGENT",
        help="compare all with this agent: pid, or a label like 'SAC K=1 10 Hz'",
    )
    add("--protocol", metavar="NAME", help="the evaluation that is reported: test, thesis, robustness")
    add("--condition", metavar="NAME", help="the test condition within the protocol: nominal, current=0.5")
    add("--format", metavar="NAME,...", help=",".join(FORMATS))
    add(
        "--figures",
        action=argparse.BooleanOptionalAction,
        default=None,
        help="draw the figures; formats md and html show them",
    )
    add("--out", metavar="DIR", help="folder of the report; default <experiment>/report")
    add("--study", metavar="NAME", help=f"answer the claims of a study: {', '.join(STUDIES)}")
    add("--confidence", metavar="P", help="of every interval, between 0.5 and 0.999")
    add("--margin", metavar="M", help="smallest difference of interest, in the measure's unit: 2 is 2 points")
    add("--failed-trainings", metavar="HOW", help="zero: a failed training is a seed without success; omit")
    add("--seed", metavar="N", help="of the permutation tests of --study")
    return parser


def _read_preset(path: Any) -> dict[str, Any]:
    try:
        settings = documents.yaml_value(
            reading.content(path) if isinstance(path, Path) else path.read_bytes()
        )
    except OSError as error:
        raise UserError(f"cannot read the preset {path}: {error.strerror or error}") from error
    except ValueError as error:
        raise UserError(f"the preset {path} is not valid YAML: {error}") from error
    if not isinstance(settings, Mapping):
        raise UserError(f"the preset {path} holds no options")
    return _known(settings, str(path))


def _known(settings: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return options by their names, all of which a report has."""
    known = [
        field.name for field in fields(Options) if field.name not in ("declared", "instead", "undecided")
    ]
    named = {str(key).replace("-", "_"): value for key, value in settings.items()}
    for key in named:
        if key not in known:
            raise UserError(f"unknown option {key!r} in {where}; {closest(key, known)}")
    return named


def _options(settings: Mapping[str, Any]) -> Options:
    formats = _names(settings["format"])
    for name in formats:
        if name not in FORMATS:
            raise UserError(f"unknown format {name!r}; {closest(name, FORMATS)}")
    study = settings["study"]
    if study is not None and study not in STUDIES:
        raise UserError(f"unknown study {study!r}; {closest(str(study), STUDIES)}")
    confidence = _number("confidence", settings["confidence"], 0.5, 0.999)
    for name in ("figures", "pairs", "all_findings"):
        if not isinstance(settings[name], bool):
            raise UserError(f"{name}={settings[name]!r} is neither true nor false")
    return Options(
        rank_by=str(settings["rank_by"]),
        then=str(settings["then"]),
        group_by=_names(settings["group_by"]),
        columns=() if settings["columns"] is None else _names(settings["columns"]),
        pairs=settings["pairs"],
        all_findings=settings["all_findings"],
        baseline=None if settings["baseline"] is None else str(settings["baseline"]),
        protocol=str(settings["protocol"]),
        condition=None if settings["condition"] is None else str(settings["condition"]),
        format=formats,
        figures=settings["figures"],
        out=None if settings["out"] is None else Path(str(settings["out"])),
        study=study,
        confidence=confidence,
        margin=None if settings["margin"] is None else _positive("margin", settings["margin"]),
        failed_trainings=_choice("failed_trainings", settings["failed_trainings"], FAILED_TRAININGS),
        seed=_whole("seed", settings["seed"], 0, 2**32 - 1),
        where=_terms(settings["where"]),
    )


def _terms(value: Any) -> tuple[str, ...]:
    terms = [value] if isinstance(value, str) else value
    if not isinstance(terms, list) or not all(isinstance(term, str) for term in terms):
        raise UserError(f"where: {value!r} is no list of terms such as reward.k=1,40")
    return tuple(terms)


def _names(value: Any) -> tuple[str, ...]:
    names = value.split(",") if isinstance(value, str) else value
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise UserError(f"{value!r} is not a list of names")
    cleaned = tuple(dict.fromkeys(name.strip() for name in names if name.strip()))
    if not cleaned:
        raise UserError(f"an empty list of names: {value!r}")
    return cleaned


def _number(name: str, value: Any, low: float, high: float) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = float("nan")
    if not low <= number <= high:
        raise UserError(f"{name}={value!r} is not a number from {low:g} to {high:g}")
    return number


def _choice(name: str, value: Any, valid: Sequence[str]) -> str:
    if value not in valid:
        raise UserError(f"{name}={value!r} is unknown; {closest(str(value), valid)}")
    return str(value)


def _positive(name: str, value: Any) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = float("nan")
    if not 0 < number < float("inf"):
        raise UserError(f"{name}={value!r} is not a positive number, for example 2")
    return number


def _whole(name: str, value: Any, low: int, high: int) -> int:
    try:
        number = int(str(value))
    except ValueError:
        number = low - 1
    if not low <= number <= high:
        raise UserError(f"{name}={value!r} is not a whole number from {low} to {high}")
    return number

"""Options of a report: the keys of conf/report.yaml, which a declared analysis and the command line can change."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields, replace
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from auvbench.errors import UserError, closest
from auvbench.runs import declared as analyses
from auvbench.runs.declared import Declared
from auvbench.untrusted import reading, typed_json
from auvbench.untrusted.typed_json import Count, Name, Range

Format = Literal["terminal", "md", "tex", "csv", "html"]
Study = Literal["thesis"]
FORMATS, STUDIES = get_args(Format), get_args(Study)


@dataclass(frozen=True, slots=True)
class Options:
    """Options of a report; conf/report.yaml explains each of them."""

    rank_by: Name
    primary: dict[Name, Name]
    names: dict[Name, str]
    trials: dict[Name, Count]
    columns: tuple[Name, ...]
    baseline: Name | None
    protocol: Name
    condition: Name | None
    also: tuple[Name, ...]
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
    """Options before the command line changes them: the defaults with the changes of the declared analysis"""
    undecided: str = ""
    """Reason why no declared analysis is used, if the runs have several; '' otherwise"""


OF_THE_DECLARATION = ("declared", "declared_in", "usual", "undecided")
KEYS = tuple(field.name for field in fields(Options) if field.name not in OF_THE_DECLARATION)
LISTS = ("columns", "also", "format")
"""options that may be given as comma-separated lists"""

STORED = ("primary", "names", "trials", "columns", "protocol", "condition", "study", "confidence")
"""Options that a published study stores if they differ from conf/report.yaml"""
OF_THE_TABLE = tuple(name for name in STORED if name not in ("protocol", "condition"))
"""`STORED` without the protocol and the condition. A published study stores only these options if its declaration
names the protocol and the conditions.
"""


def defaults() -> Options:
    """Return the options of conf/report.yaml."""
    return converted(settings())


def settings() -> dict[str, Any]:
    """Return the values of conf/report.yaml by option."""
    text = (resources.files("auvbench.conf") / "report.yaml").read_bytes()
    return named(reading.yaml_value(text))


def named(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values by option name, with each hyphen of a name replaced by an underscore.

    Raises:
        UserError: a name is unknown.
    """
    options = {str(key).replace("-", "_"): value for key, value in values.items()}
    for key in options:
        if key not in KEYS:
            raise UserError(f"unknown option {key!r} of a report; {closest(key, KEYS)}")
    return options


def converted(given: Mapping[str, Any], typed: Collection[str] = ()) -> Options:
    """Return the options, converted to their types and checked against their ranges.

    Args:
        given: value of each option.
        typed: options from the command line; an error names them as flags.

    Raises:
        UserError: a value has a wrong type, or is out of range.
    """
    values = {key: given[key] for key in KEYS}
    for key in LISTS:
        if isinstance(values[key], str):
            values[key] = list(dict.fromkeys(name.strip() for name in values[key].split(",")))
    for key in ("columns", "also"):
        values[key] = values[key] or []
    for key in ("primary", "names", "trials"):
        values[key] = values[key] or {}
    try:
        options = typed_json.convert(values, Options)
    except ValueError as error:
        entry, _, reason = str(error).partition(" ")
        key = entry.partition("[")[0]  # the error names an item of a list as format[0]
        raise UserError(f"{_flag(key)} {reason}" if key in typed else f"report: {error}") from error
    return replace(options, out=None if options.out is None else Path(str(options.out)))


def _flag(key: str) -> str:
    return f"--{key.replace('_', '-')}"

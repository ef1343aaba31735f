"""What is typed, before Hydra reads it: whole numbers, paths and letters that its grammar does not take as they are.

Also names the overrides of Hydra that have no meaning here, with what has.
"""

from __future__ import annotations

import dataclasses
import os
import re
import unicodedata
from collections.abc import Sequence
from functools import cache

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException

from auvbench.config import launchers, schema, simulation, simulators, tuning
from auvbench.config.agents import AGENTS
from auvbench.config.suggestions import whole
from auvbench.errors import ConfigError

_LAYOUT = "runs lie in <output>/<name>/<run id>: output=FOLDER and name=NAME choose where"
_PLACE = "where runs are carried out is launcher=local, slurm or ray"

REFUSED = {
    "hydra.run.dir": _LAYOUT,
    "hydra.sweep.dir": _LAYOUT,
    "hydra.sweep.subdir": _LAYOUT,
    "hydra.output_subdir": "a run's configuration is config.yaml in its folder",
    "hydra.job.chdir": "a command stays in the working directory",
    "hydra/launcher": _PLACE,
    "hydra/sweeper": "grids are made by -m and by hydra.sweeper.grids of an experiment",
    "hydra/job_logging": "a run's log is train/log.txt in its folder",
    "hydra/hydra_logging": "a run's log is train/log.txt in its folder",
}
"""Overrides of Hydra that nothing here obeys, and what does what they are for."""

_OWN_FILES = "files of your own go to ./conf, or to a folder that -cd FOLDER names"
_OWN_PRESET = "a preset of your own goes to ./conf/experiment/NAME.yaml and is chosen by experiment=NAME"

FLAGS = {
    "--config-path": _OWN_FILES,
    "-cp": _OWN_FILES,
    "--config-name": _OWN_PRESET,
    "-cn": _OWN_PRESET,
    "--experimental-rerun": "it would unpickle a file; type the command again instead",
}
"""Flags of Hydra that would do harm here, and what does what they are for."""

PATHS = ("output", "plot")
"""Keys that hold a path."""

_NUMBER = re.compile(r"(?<![\w.])[+-]?\d[\d_]*(?:\.\d*)?(?:[eE][+-]?\d+)?(?![\w.])")

# What Hydra's grammar takes unquoted in a value.
_PLAIN = re.compile(r"[A-Za-z0-9_.,:/\\+*%@?|$=\[\]{}()'\" \t-]*")


def read(overrides: Sequence[str]) -> list[str]:
    """The overrides as Hydra's grammar wants them.

    Raises:
        ConfigError: one is an override of Hydra that has no meaning here, or has an invisible character.

    >>> read(["train.total_steps=1e6", "output=Größe", "algo.gamma=0.9"])
    ['train.total_steps=1000000', "output='Größe'", 'algo.gamma=0.9']
    """
    for override in overrides:
        key = override.partition("=")[0].lstrip("+~")
        if key in REFUSED:
            raise ConfigError(f"{override}: has no effect here; {REFUSED[key]}")
        hidden = [c for c in override if unicodedata.category(c) == "Cf"]
        if hidden:
            raise ConfigError(f"{override}: contains U+{ord(hidden[0]):04X}, a character that is not shown")
    return [_read(override) for override in overrides]


def _read(override: str) -> str:
    key, separator, value = override.partition("=")
    if not separator:
        return override
    if key.lstrip("+") in whole_keys():
        return f"{key}={_NUMBER.sub(_whole, value)}"
    if key in PATHS and value.startswith("~"):
        value = os.path.expanduser(value)  # leaves an unknown user as it is, where pathlib raises
    if value and (key in PATHS or not _PLAIN.fullmatch(value)) and value[0] not in "'\"[{":
        return _quoted(key, value)
    return f"{key}={value}"


def _whole(match: re.Match[str]) -> str:
    """1e6 and 1000000.0 are whole numbers; 1.5 is left for the schema to refuse."""
    text = match[0]
    number = whole(text) if set(text) & set(".eE") else None
    return text if number is None else str(number)


def _quoted(key: str, value: str) -> str:
    """In quotes where Hydra cannot read it otherwise; the parts of a list each in its own."""
    written = f"{key}={value}"
    try:
        parsed = OverridesParser.create().parse_override(written)
        if key not in PATHS or parsed.value() is None or isinstance(parsed.value(), str):
            return written
        if parsed.is_sweep_override():
            return written
    except HydraException:
        pass
    parts = value.split(",") if key not in PATHS else [value]
    return f"{key}={','.join(map(_quote, parts))}"


def _quote(text: str) -> str:
    escaped = re.sub(r"(\\*)'", r"\1\1\\'", text)
    trailing = len(escaped) - len(escaped.rstrip("\\"))  # would escape the closing quote
    return f"'{escaped}{escaped[len(escaped) - trailing :]}'"


@cache
def whole_keys() -> frozenset[str]:
    """The dotted keys of all configurations that hold a whole number."""
    found: set[str] = set()
    for root in (schema.TrainConfig, schema.EvaluateConfig, simulation.Simulation):
        found |= _whole_below(root, "")
    found |= _whole_below(tuning.Tune, "tune.")
    for spec in AGENTS.values():
        found |= _whole_below(spec.schema, "algo.")
    for group, kinds in (("launcher", launchers.SCHEMAS), ("simulator", simulators.SCHEMAS)):
        for kind in kinds.values():
            found |= _whole_below(kind, f"{group}.")
    return frozenset(found)


def _whole_below(kind: type, prefix: str) -> set[str]:
    found = set()
    for field in dataclasses.fields(kind):
        key = f"{prefix}{field.name}"
        if str(field.type) in ("int", "int | None", "list[int]"):
            found.add(key)
        nested = getattr(schema, str(field.type), None)
        if isinstance(nested, type) and dataclasses.is_dataclass(nested):
            found |= _whole_below(nested, f"{key}.")
    return found

"""Overrides as they are typed, before Hydra reads them: whole numbers and texts that its grammar does not take."""

from __future__ import annotations

import os
import re
import unicodedata
from collections.abc import Sequence
from functools import cache

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException

from auvbench.config import schema, simulation, simulators, tuning
from auvbench.config.agents import AGENTS
from auvbench.config.restricted_yaml import ALLOWED
from auvbench.errors import ConfigError

PATHS = ("output", "plot")
"""Keys that hold a path."""

CHOICES = {"algo.base": "algo/base@algo"}
"""Keys whose values are names of files, as Hydra calls them."""

_NUMBER = re.compile(r"(?<![\w.])[+-]?\d[\d_]*(?:\.\d*)?(?:[eE][+-]?\d+)?(?![\w.])")


def read(overrides: Sequence[str]) -> list[str]:
    """Return the overrides in Hydra's grammar.

    Raises:
        ConfigError: one sets a key of Hydra's own that has no effect, or has an invisible character.

    >>> read(["train.total_steps=1e6", "output=Größe", "algo.gamma=0.9"])
    ['train.total_steps=1000000', "output='Größe'", 'algo.gamma=0.9']
    """
    for override in overrides:
        key = override.partition("=")[0].lstrip("+~")
        if re.match("hydra[./]", key) and not key.startswith(ALLOWED):
            raise ConfigError(
                f"{override}: has no effect here; output=FOLDER and name=NAME choose where runs lie, launcher=NAME where "
                "they are carried out"
            )
        hidden = next((character for character in override if unicodedata.category(character) == "Cf"), None)
        if hidden is not None:
            raise ConfigError(f"{override}: contains U+{ord(hidden):04X}, a character that is not shown")
    return [_read(override) for override in overrides]


def _read(override: str) -> str:
    key, separator, value = override.partition("=")
    key = CHOICES.get(key, key)
    if key.lstrip("+") in whole_keys():
        value = _NUMBER.sub(_whole, value)
    if key in PATHS:
        value = os.path.expanduser(value)  # leaves an unknown user as it is, where pathlib raises
    written = f"{key}{separator}{value}"
    is_text = key in PATHS or not re.match(r"""\w*[(\[{'"]""", value)
    if not value or not is_text or is_valid(written):
        return written
    return f"{key}={quote(value)}"


def is_valid(override: str) -> bool:
    """Return whether Hydra's grammar takes an override."""
    try:
        OverridesParser.create().parse_override(override)
    except (HydraException, RecursionError):
        return False
    return True


def quote(text: str) -> str:
    """Return a text in quotes, as Hydra's grammar takes it."""
    escaped = re.sub(r"(\\*)'", r"\1\1\\'", text)
    trailing = len(escaped) - len(escaped.rstrip("\\"))  # would escape the closing quote
    return f"'{escaped}{escaped[len(escaped) - trailing :]}'"


def whole(text: str) -> int | None:
    """Return the whole number that a text stands for: 1e6 is one, 1.5 is not.

    >>> whole("1e6"), whole("2_000"), whole("1.5"), whole("many")
    (1000000, 2000, None, None)
    """
    try:
        return int(text)
    except ValueError:
        pass
    try:
        number = float(text)
    except ValueError:
        return None
    # Beyond 2^53 a float does not say which whole number is meant.
    return int(number) if number.is_integer() and abs(number) <= 2**53 else None


def _whole(match: re.Match[str]) -> str:
    number = whole(match[0])
    return match[0] if number is None else str(number)


@cache
def whole_keys() -> frozenset[str]:
    """Return the dotted keys of all configurations that hold a whole number."""
    kinds: list[tuple[type, str]] = [
        (root, "") for root in (schema.TrainConfig, schema.EvaluateConfig, simulation.Simulation)
    ]
    kinds += [(tuning.Tune, "tune."), *((spec.schema, "algo.") for spec in AGENTS.values())]
    kinds += [(kind, "launcher.") for kind in schema.LAUNCHERS.values()]
    kinds += [(kind, "simulator.") for kind in simulators.SCHEMAS.values()]
    return frozenset(
        key
        for kind, prefix in kinds
        for key, hint in schema.keys(kind, prefix).items()
        if hint in (int, int | None, list[int])
    )

"""Read overrides before Hydra does, and translate errors of Hydra or OmegaConf into one line.

Hydra's grammar rejects some whole numbers and texts that users type, so `read` rewrites them first. An error's
line names the key, the value and the closest valid name.
"""

from __future__ import annotations

import os
import re
import unicodedata
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import yaml
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException, MissingConfigException, OverrideParseException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import ConfigAttributeError, ConfigKeyError, OmegaConfBaseException, ValidationError

from auvbench.config import folders, schema, simulation, suggestions, tuning
from auvbench.config.restricted_yaml import ALLOWED
from auvbench.errors import ConfigError, closest
from auvbench.registry import AGENTS, LAUNCHERS, SIMULATORS
from auvbench.untrusted.reading import DIGITS, no_yaml

PATHS = ("output", "plot")
"""Keys whose values are paths."""

CHOICES = {"algo.base": "algo/base@algo"}
"""Keys whose values choose a configuration file, each with the key in Hydra's grammar."""

SEVERAL = ("disturbance", "experiment", "search")
"""Groups of which a run may have several options."""

_NUMBER = re.compile(r"(?<![\w.])[+-]?\d[\d_]*(?:\.\d*)?(?:[eE][+-]?\d+)?(?![\w.])")

Compose = Callable[[Sequence[str]], DictConfig]

INNER = (AssertionError, AttributeError, IndexError, KeyError, TypeError)
"""Internal errors that Hydra raises if an override's key is below a single value, for example `hydra.sweeper.params.seed=1`"""

FAULTS = (HydraException, OmegaConfBaseException, yaml.YAMLError, ValueError, OSError, RecursionError, *INNER)
"""Exceptions that Hydra raises for a mistake in an override or in a file of `./conf`"""

_KINDS = {"Integer": "a whole number", "Float": "a number", "Boolean": "true or false"}


def read(overrides: Sequence[str]) -> list[str]:
    """Return the overrides in Hydra's grammar.

    Raises:
        ConfigError: an override has no key, removes a key, sets a key of Hydra that has no effect, names several
            options of a group that takes one, or has an invisible character or too many digits.

    >>> read(["train.total_steps=1e6", "output=Größe", "algo.gamma=0.9"])
    ['train.total_steps=1000000', "output='Größe'", 'algo.gamma=0.9']
    """
    for override in overrides:
        key = override.partition("=")[0].lstrip("+~")
        if not key:
            raise ConfigError(f"{override!r}: an override must be key=value")
        if re.match(r"~\w+(=|$)", override) and key not in ("experiment", "search"):
            raise ConfigError(f"{override}: a key cannot be removed; type {key}=VALUE")
        if re.match(r"~disturbance\.\w+(=|$)", override):
            raise ConfigError(
                f"{override}: a disturbance cannot be removed; type disturbance=none for no disturbance"
            )
        if re.match("hydra[./]", key) and not key.startswith(ALLOWED):
            raise ConfigError(
                f"{override}: has no effect; use output=FOLDER and name=NAME to choose the folder of the "
                "runs, launcher=NAME "
                "to choose where they are trained"
            )
        if several := _of_one_group(override):
            raise ConfigError(several)
        if (digits := max(map(len, re.findall(r"\d+", override)), default=0)) > DIGITS:
            raise ConfigError(f"{key}: a number has {digits:,} digits; must have at most {DIGITS}")
        hidden = next((character for character in override if unicodedata.category(character) == "Cf"), None)
        if hidden is not None:
            raise ConfigError(f"{override}: contains U+{ord(hidden):04X}, an invisible character; remove it")
    return [_read(override) for override in overrides]


def _of_one_group(override: str) -> str:
    """Return the error for a list of a group's options, such as `task=[docking,transit]`; '' for any other override.

    Hydra would silently use only the last option. A list with an unknown option is not an error here: Hydra rejects it later.
    """
    key, _, value = override.partition("=")
    names = re.fullmatch(r"\[\s*([\w./-]+(?:\s*,\s*[\w./-]+)*)\s*\]", value)
    if names is None or key in SEVERAL:
        return ""
    options = re.split(r"\s*,\s*", names[1])
    if not set(options) <= set(folders.options(key)):
        return ""
    hint = (
        f"; for several (a grid) type auvbench train -m {key}={','.join(options)}"
        if options[1:] and key not in suggestions.OF_COMMANDS
        else f"; type {key}={options[0]}"
    )
    return f"{override}: takes one name{hint}"


def _read(override: str) -> str:
    key, separator, value = override.partition("=")
    key = CHOICES.get(key, key)
    value = whole_numbers(key.lstrip("+"), value)
    if key in PATHS:
        value = os.path.expanduser(value)  # unlike pathlib, leaves ~NAME of an unknown user unchanged
    written = f"{key}{separator}{value}"
    is_text = key in PATHS or not re.match(r"""\w*[(\[{'"]""", value)
    if value and is_text:
        try:
            OverridesParser.create().parse_override(written)
        except (HydraException, RecursionError):
            return f"{key}={quote(value)}"
    return written


def whole_numbers(key: str, text: str) -> str:
    """Return the text of a value; if the key needs whole numbers, write 1e6 as 1000000."""
    return _NUMBER.sub(_whole, text) if key in whole_keys() else text


def quote(text: str) -> str:
    """Return a text in quotes of Hydra's grammar."""
    escaped = re.sub(r"(\\*)'", r"\1\1\\'", text)
    trailing = len(escaped) - len(escaped.rstrip("\\"))  # a trailing backslash would escape the closing quote
    return f"'{escaped}{escaped[len(escaped) - trailing :]}'"


def _whole(match: re.Match[str]) -> str:
    number = schema.whole(match[0])
    return match[0] if number is None else str(number)


@cache
def whole_keys() -> frozenset[str]:
    """Return the dotted keys of all commands' configurations whose values must be whole numbers."""
    kinds: list[tuple[type, str]] = [
        (root, "") for root in (schema.TrainConfig, schema.EvaluateConfig, simulation.Simulation)
    ]
    kinds.append((tuning.Tune, "tune."))
    for group, specs in (("algo.", AGENTS), ("launcher.", LAUNCHERS), ("simulator.", SIMULATORS)):
        kinds += [(specs[name].schema, group) for name in specs.own]
    return frozenset(
        key
        for kind, prefix in kinds
        for key, hint in schema.keys(kind, prefix).items()
        if hint in (int, int | None, list[int])
    )


def translate(error: BaseException, compose: Compose, entry: str, overrides: Sequence[str]) -> ConfigError:
    """Return an error with a one-line message.

    Args:
        error: one of `FAULTS`, or any other exception.
        compose: function that composes the command's configuration from overrides, to suggest valid keys.
        entry: name of the command: train, evaluate, tune or simulate.
        overrides: overrides as typed.

    Raises:
        KeyboardInterrupt: a Ctrl-C caused the error.
    """
    chain: list[BaseException] = []
    cause: BaseException | None = error
    while cause is not None and cause not in chain:
        chain.append(cause)
        cause = cause.__cause__ or cause.__context__
    for link in chain:
        if isinstance(link, ConfigError):
            return link
        if isinstance(link, KeyboardInterrupt):  # OmegaConf wraps a Ctrl-C in its own exception.
            raise link
    text = " ".join(str(error).split("\nSee ")[0].split())
    if isinstance(error, OverrideParseException):
        if "=" not in error.override:
            return ConfigError(f"{error.override!r}: an override must be key=value")
        key = error.override.partition("=")[0]
        return ConfigError(
            f"{error.override}: the value cannot be read; put the override in single quotes and each text with special "
            f"characters in double quotes: '{key}=\"TEXT\"'"
        )
    if reason := _misfit(compose, overrides):
        return ConfigError(reason)
    if isinstance(error, MissingConfigException) and error.options:
        group, _, option = str(error.missing_cfg_file).rpartition("/")
        if misnamed := folders.misnamed(group, option):
            return ConfigError(
                f"{misnamed}: has the wrong suffix; rename it to {misnamed.with_suffix('.yaml').name}"
            )
        options = [name for name in error.options if not name.endswith("_schema")]
        path = f"; put your own file into ./conf/{group}" if option.endswith(".yaml") else ""
        return ConfigError(
            f"{group.replace('/', '.')}={option}: no such option; {closest(option, options)}{path}"
        )
    overridden = re.search(r"Could not override '([^']+)'", text)
    for link in chain:
        key = str(getattr(link, "full_key", None) or getattr(link, "key", None) or "the configuration")
        if isinstance(link, ConfigKeyError | ConfigAttributeError):
            return ConfigError(f"{key}: unknown key; {_near_key(key, compose, entry, overrides)}")
        if isinstance(link, OmegaConfBaseException) and not overridden:
            reason = str(getattr(link, "msg", None) or link).split("\n")[0]
            wrong = re.match(r"Value '(.*)' of type '\w+' could not be converted to (\w+)", reason)
            if isinstance(link, ValidationError) and wrong:
                reason = f"{wrong[1]!r} is not {_KINDS.get(wrong[2], wrong[2])}"
            if kind := re.match(r"Cannot convert '(list|dict)' to string", reason):
                reason = f"takes one value, not {'a list' if kind[1] == 'list' else 'keys'}"
            if reason.endswith("is not Optional"):
                return ConfigError(f"{key}=null: a value is missing")
            return ConfigError(f"{'a group' if key == '_dummy_' else key}: {reason}")
    if overridden:
        key = next((key for key, choice in CHOICES.items() if choice == overridden[1]), overridden[1])
        return ConfigError(f"{key}: unknown key; {_near_key(key, compose, entry, overrides)}")
    if several := re.search(r"Ambiguous value for argument '([^']*)'", text):
        key, _, values = several[1].partition("=")
        if entry not in ("train", "tune"):
            return ConfigError(f"{key}={values}: takes one value; grids are for auvbench train -m")
        if reason := _first_wrong(key, values, compose, overrides):
            return ConfigError(reason)
        as_list = "" if folders.options(key) else f"; write a list as [{values}]"
        return ConfigError(
            f"{key}={values}: several values make a grid: auvbench {entry} -m {key}={values}{as_list}"
        )
    if several := re.search(r"Sweep parameters '([^']*)' requires --multirun", text):
        return ConfigError(
            f"{several[1]}: several values make a grid: auvbench {entry} -m '{several[1]}'"
            if entry in ("train", "tune")
            else f"{several[1]}: takes one value; grids are for auvbench train -m"
        )
    return ConfigError(_unread(error, overrides) or text)


def _misfit(compose: Compose, overrides: Sequence[str]) -> str:
    """Return what is wrong with the first override that does not fit the configuration; '' if all overrides fit."""
    if not overrides:
        return ""
    from auvbench.config import misfits  # imported late, since only errors need it

    try:
        parsed = [_read(override) for override in overrides]
        return misfits.explain(parsed, misfits.plain(compose(misfits.chosen(parsed))))
    except (*FAULTS, ConfigError):  # A configuration file is wrong, not an override.
        return ""


def _first_wrong(key: str, values: str, compose: Compose, overrides: Sequence[str]) -> str:
    """Return what is wrong with the first invalid value among a key's comma-separated values; '' if all are valid.

    At most eight values are checked.
    """
    from auvbench.config.validate import train_config

    # Sweeps of other keys are left out: checking all combinations would take long.
    single_values = [override for override in overrides if not _is_sweep(override)]
    for value in values.split(",")[:8]:
        words = [*single_values, f"{key}={value}"]
        try:
            train_config(compose(read(words)))
        except (*FAULTS, ConfigError) as error:
            reason = str(translate(error, compose, "train", words))
            if reason.startswith((f"{key}={value}:", f"{key}:")):
                return reason
    return ""


def _is_sweep(override: str) -> bool:
    try:
        return bool(OverridesParser.create().parse_override(_read(override)).is_sweep_override())
    except (HydraException, RecursionError):
        return False


def _unread(error: BaseException, overrides: Sequence[str]) -> str:
    """Return what is wrong with a file of `./conf`, or with an override that Hydra does not check; '' if unknown."""
    if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark is not None:
        return f"{error.problem_mark.name} {no_yaml(error)}"
    if isinstance(error, RecursionError):
        return "the defaults lists of the files in conf/ form a circle: a file includes itself through others; remove one entry"
    if isinstance(error, UnicodeDecodeError):
        return f"a file in conf/ is not UTF-8 text: {error.reason} at byte {error.start}"
    group = next(
        (o for o in overrides if re.fullmatch(r"(\w+|algo\.base)=(null|true|false|[\d.]+)", o)), None
    )
    if "Config group override must be a string" in str(error) and group is not None:
        return (
            f"{group}: name an option, e.g. {group.partition('=')[0]}=NAME (auvbench train --help lists them)"
        )
    if isinstance(error, INNER):
        return f"{' '.join(overrides)}: cannot be composed ({' '.join(str(error).split())})"
    return ""


def _near_key(key: str, compose: Compose, entry: str, overrides: Sequence[str]) -> str:
    # The chosen options decide which keys exist: algo=sac and algo=ppo have different keys.
    groups = [override.split(",")[0] for override in overrides if re.match(r"\w+=", override)]
    keys: list[str] = []
    for chosen in (groups, []):
        try:
            keys = leaves(OmegaConf.to_container(compose(chosen)))
            break
        except (*FAULTS, ConfigError):
            continue
    return suggestions.unknown_key(key, keys, f"auvbench {entry}")


def leaves(node: Any, prefix: str = "") -> list[str]:
    """Return all dotted keys of a nested mapping."""
    if not isinstance(node, dict):
        return []
    return [
        name for key, child in node.items() for name in (f"{prefix}{key}", *leaves(child, f"{prefix}{key}."))
    ]

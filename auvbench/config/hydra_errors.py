"""What is wrong with what was typed, or with a file of `./conf`, in one line: from Hydra's and OmegaConf's messages."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import yaml
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import (
    ConfigCompositionException,
    HydraException,
    MissingConfigException,
    OverrideParseException,
)
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import (
    ConfigAttributeError,
    ConfigKeyError,
    InterpolationResolutionError,
    MissingMandatoryValue,
    OmegaConfBaseException,
    ValidationError,
)

from auvbench.config import installed, suggestions
from auvbench.errors import ConfigError, closest

Compose = Callable[[Sequence[str]], DictConfig]

INNER = (AssertionError, AttributeError, IndexError, KeyError, TypeError)
"""Hydra's own where an override leads through what is no mapping, `hydra.sweeper.params.seed=1` for example."""

FAULTS = (
    HydraException,
    OmegaConfBaseException,
    yaml.YAMLError,
    ValueError,
    OSError,
    RecursionError,
    *INNER,
)
"""What Hydra lets out for a mistake in what was typed, or in a file of `./conf`."""


def translate(error: BaseException, compose: Compose, entry: str, overrides: Sequence[str]) -> ConfigError:
    """One line that names the value and what would be right, from Hydra's and OmegaConf's messages.

    Args:
        error: one of `FAULTS`, or anything else.
        compose: the command's configuration with some overrides, for the keys there are.
        entry: the command: train, evaluate, tune.
        overrides: what was typed.
    """
    chain: list[BaseException] = []
    cause: BaseException | None = error
    while cause is not None and cause not in chain:
        chain.append(cause)
        cause = cause.__cause__ or cause.__context__
    for link in chain:
        if isinstance(link, ConfigError):
            return link
        if isinstance(link, KeyboardInterrupt):  # OmegaConf makes an error of its own of a Ctrl-C
            raise link
    text = str(error)
    if not isinstance(error, HydraException | OmegaConfBaseException):
        return ConfigError(_unread(error, overrides))
    if isinstance(error, OverrideParseException):
        return ConfigError(_unparsed(error.override))
    if isinstance(error, MissingConfigException):
        option = error.missing_cfg_file or "?"
        if option.endswith((".yaml", ".yml")) and "/" in option:
            group, stem = option.split("/")[0], Path(option).stem
            return ConfigError(
                f"{group}={option.removeprefix(group + '/')}: name an option, not a file; a file of your own goes to"
                f" ./conf/{group}/{stem}.yaml and is chosen by {group}={stem}"
            )
        if error.options:
            group, _, wanted = option.rpartition("/")
            options = [name for name in error.options if not name.endswith("_schema")]
            if (bare := installed.without_file(group, wanted)) is not None:
                return bare
            return ConfigError(f"{group}={wanted}: no such option; {closest(wanted, options)}")
        return ConfigError(f"{option}: no such configuration")
    for link in chain:
        if isinstance(link, ConfigKeyError | ConfigAttributeError):
            key = getattr(link, "full_key", None) or getattr(link, "key", "?")
            return ConfigError(f"{key}: unknown key; {_near_key(str(key), compose, entry, overrides)}")
        if isinstance(link, ValidationError):
            key = getattr(link, "full_key", None) or "?"
            message = (getattr(link, "msg", None) or str(link)).splitlines()[0]
            return ConfigError(f"{key}: {_plain(message)}")
        if isinstance(link, InterpolationResolutionError):
            key = getattr(link, "full_key", None) or "?"
            reason = (getattr(link, "msg", None) or str(link)).splitlines()[0]
            return ConfigError(f"{'a group' if key == '_dummy_' else key}: {reason}")
        if isinstance(link, MissingMandatoryValue):
            return ConfigError(f"{getattr(link, 'full_key', '?')}: a value is missing")
    overridden = re.search(r"Could not override '([^']+)'", text)
    if overridden:
        key = overridden.group(1)
        return ConfigError(f"{key}: no such question or key; {_near_key(key, compose, entry, overrides)}")
    several = re.search(r"Ambiguous value for argument '([^']*)'", text)
    if several:
        key, _, values = several.group(1).partition("=")
        return ConfigError(_several(key, values, compose, entry))
    if isinstance(error, ConfigCompositionException | HydraException):
        return ConfigError(" ".join(text.split("\nSee ")[0].split()))
    return ConfigError(" ".join(text.split()))


def _unread(error: BaseException, overrides: Sequence[str]) -> str:
    """What is wrong with a file of `./conf`, or with an override that Hydra does not get as far as to check."""
    if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark is not None:
        mark = error.problem_mark
        return f"{mark.name} line {mark.line + 1}: no YAML: {error.problem}"
    if isinstance(error, INNER):
        given = " ".join(overrides) or "what was typed"
        return f"{given}: cannot be composed ({' '.join(str(error).split())})"
    if isinstance(error, RecursionError):
        return "the defaults lists of the files in conf/ name each other in a circle"
    if isinstance(error, UnicodeDecodeError):
        return f"a file in conf/ is no text in UTF-8: {error.reason} at byte {error.start}"
    group = next((o for o in overrides if re.fullmatch(r"\w+=(null|true|false|[\d.]+)", o)), None)
    if "Config group override must be a string" in str(error) and group is not None:
        return (
            f"{group}: name an option, e.g. {group.partition('=')[0]}=NAME (auvbench train --help lists them)"
        )
    return " ".join(str(error).split())


def _unparsed(override: str) -> str:
    """Return what to type in place of an override that is outside Hydra's grammar."""
    key, separator, value = override.partition("=")
    if not separator:
        return f"{override!r}: an override is written key=value"
    quoted = key + "=" + re.sub(r"""(?<![\w."'])[\w./]+=[^\s,\[\]{}"']+""", r'"\g<0>"', value)
    try:
        OverridesParser.create().parse_override(quoted)
    except HydraException:
        example = '[{name: a, overrides: ["simulator=ros2"]}]' if key == "protocol.conditions" else '"TEXT"'
        return (
            f"{override}: the value cannot be read; put the whole in single quotes and each text with special characters "
            f"in double quotes: '{key}={example}'"
        )
    return f"{override}: the value cannot be read; put each text with a = in double quotes: {shlex.quote(quoted)}"


def _several(key: str, values: str, compose: Compose, entry: str) -> str:
    if entry not in ("train", "tune"):
        return f"{key}={values}: one value at a time; grids are for auvbench train -m"
    known = OmegaConf.to_container(compose(()))
    for part in key.split("."):
        known = known.get(part) if isinstance(known, dict) else None
    listed = f" (a list is written [{values}])" if isinstance(known, list) else ""
    return f"{key}={values}: several values make a grid: auvbench {entry} -m {key}={values}{listed}"


def _near_key(key: str, compose: Compose, entry: str, overrides: Sequence[str]) -> str:
    # The chosen groups decide which keys exist: algo=sac has others than algo=ppo.
    groups = [override.split(",")[0] for override in overrides if re.match(r"\w+=", override)]
    known: list[str] = []
    for chosen in (groups, []):
        try:
            known = leaves(OmegaConf.to_container(compose(chosen)))
            break
        except (*FAULTS, ConfigError):
            continue
    answers = dict(group.split("=", 1) for group in groups)
    return suggestions.unknown_key(key, known, answers, f"auvbench {entry}")


def _plain(message: str) -> str:
    match = re.match(r"Value '(.*)' of type '\w+' could not be converted to (\w+)", message)
    if match:
        kind = {"Integer": "a whole number", "Float": "a number", "Boolean": "true or false"}
        return f"{match.group(1)!r} is not {kind.get(match.group(2), match.group(2))}"
    return message


def leaves(node: Any, prefix: str = "") -> list[str]:
    """All dotted keys of a nested mapping."""
    if not isinstance(node, dict):
        return []
    return [
        name for key, child in node.items() for name in (f"{prefix}{key}", *leaves(child, f"{prefix}{key}."))
    ]

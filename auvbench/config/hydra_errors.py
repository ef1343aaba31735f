"""One line for an error of Hydra or OmegaConf, with the key, the value and the closest valid name."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Any

import yaml
from hydra.errors import HydraException, MissingConfigException, OverrideParseException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import ConfigAttributeError, ConfigKeyError, OmegaConfBaseException, ValidationError

from auvbench.config import suggestions
from auvbench.config.overrides import CHOICES
from auvbench.errors import ConfigError, closest
from auvbench.untrusted.reading import no_yaml

Compose = Callable[[Sequence[str]], DictConfig]

INNER = (AssertionError, AttributeError, IndexError, KeyError, TypeError)
"""Hydra's own for an override that leads through a value, for example `hydra.sweeper.params.seed=1`"""

FAULTS = (HydraException, OmegaConfBaseException, yaml.YAMLError, ValueError, OSError, RecursionError, *INNER)
"""Errors of Hydra for a mistake in an override or in a file of `./conf`"""

_KINDS = {"Integer": "a whole number", "Float": "a number", "Boolean": "true or false"}


def translate(error: BaseException, compose: Compose, entry: str, overrides: Sequence[str]) -> ConfigError:
    """Return the error in one line.

    Args:
        error: one of `FAULTS`, or anything else.
        compose: makes the command's configuration from some overrides; its keys are suggested.
        entry: the command: train, evaluate, tune.
        overrides: as typed.
    """
    chain: list[BaseException] = []
    cause: BaseException | None = error
    while cause is not None and cause not in chain:
        chain.append(cause)
        cause = cause.__cause__ or cause.__context__
    for link in chain:
        if isinstance(link, ConfigError):
            return link
        if isinstance(link, KeyboardInterrupt):  # OmegaConf wraps a Ctrl-C in an error of its own
            raise link
    text = " ".join(str(error).split("\nSee ")[0].split())
    if isinstance(error, OverrideParseException):
        if "=" not in error.override:
            return ConfigError(f"{error.override!r}: an override is written key=value")
        key = error.override.partition("=")[0]
        return ConfigError(
            f"{error.override}: the value cannot be read; put the whole in single quotes and each text with special "
            f"characters in double quotes: '{key}=\"TEXT\"'"
        )
    if isinstance(error, MissingConfigException) and error.options:
        group, _, wanted = str(error.missing_cfg_file).rpartition("/")
        options = [name for name in error.options if not name.endswith("_schema")]
        path = f"; a file of your own goes to ./conf/{group}" if wanted.endswith(".yaml") else ""
        return ConfigError(
            f"{group.replace('/', '.')}={wanted}: no such option; {closest(wanted, options)}{path}"
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
            if reason.endswith("is not Optional"):
                return ConfigError(f"{key}=null: a value is missing")
            return ConfigError(f"{'a group' if key == '_dummy_' else key}: {reason}")
    if overridden:
        key = next((key for key, choice in CHOICES.items() if choice == overridden[1]), overridden[1])
        return ConfigError(f"{key}: unknown key; {_near_key(key, compose, entry, overrides)}")
    if several := re.search(r"Ambiguous value for argument '([^']*)'", text):
        key, _, values = several[1].partition("=")
        if entry not in ("train", "tune"):
            return ConfigError(f"{key}={values}: give one value; grids are for auvbench train -m")
        return ConfigError(
            f"{key}={values}: several values make a grid: auvbench {entry} -m {key}={values}; a list is written [{values}]"
        )
    return ConfigError(_unread(error, overrides) or text)


def _unread(error: BaseException, overrides: Sequence[str]) -> str:
    """Return what is wrong with a file of `./conf`, or with an override that Hydra does not check."""
    if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark is not None:
        return f"{error.problem_mark.name} {no_yaml(error)}"
    if isinstance(error, RecursionError):
        return "the defaults lists of the files in conf/ name each other in a circle"
    if isinstance(error, UnicodeDecodeError):
        return f"a file in conf/ is no text in UTF-8: {error.reason} at byte {error.start}"
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
    # The chosen groups decide which keys exist: algo=sac has others than algo=ppo.
    groups = [override.split(",")[0] for override in overrides if re.match(r"\w+=", override)]
    known: list[str] = []
    for chosen in (groups, []):
        try:
            known = leaves(OmegaConf.to_container(compose(chosen)))
            break
        except (*FAULTS, ConfigError):
            continue
    return suggestions.unknown_key(key, known, f"auvbench {entry}")


def leaves(node: Any, prefix: str = "") -> list[str]:
    """Return all dotted keys of a nested mapping."""
    if not isinstance(node, dict):
        return []
    return [
        name for key, child in node.items() for name in (f"{prefix}{key}", *leaves(child, f"{prefix}{key}."))
    ]

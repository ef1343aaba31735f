"""Explain overrides that do not fit the configuration, in one line with what to type instead.

Hydra and OmegaConf report these overrides in terms of their own classes ("float is not a subclass of
Current"). So after an error, this module compares each override with the configuration. The value of a group must be
a name, a block of keys accepts values only for its keys, a list needs a list, and a single value needs one value.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import PurePath
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override, QuotedString
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf

from auvbench.config import folders
from auvbench.errors import closest
from auvbench.untrusted.text import short

SHOWN = 8
"""largest number of keys of a block that a message lists"""

ANALYSIS = "an analysis is declared in the file of an experiment; write it into ./conf/experiment/NAME.yaml and type experiment=NAME"

_ABSENT = object()


def explain(overrides: Iterable[str], config: Mapping[str, Any]) -> str:
    """Return what is wrong with the first override that does not fit the configuration; '' if all overrides fit.

    Args:
        overrides: overrides in Hydra's grammar.
        config: plain values of the command's configuration, with the files that the overrides choose.

    >>> explain(["seed=3", "seed=[1,2]"], {"seed": 42})
    'seed=[1,2]: takes one value, not a list, for example seed=42'
    >>> explain(["+seed=7"], {"seed": 42})
    '+seed=7: seed already has a value; type seed=7'
    """
    parser = OverridesParser.create()
    for text in overrides:
        try:
            override = parser.parse_override(text)
        except (HydraException, RecursionError):
            continue
        if override.package is None and (problem := _misfit(text, override, config)):
            return problem
    return ""


def chosen(overrides: Iterable[str]) -> list[str]:
    """Return the overrides that choose an existing file of a group."""
    files = []
    for override in overrides:
        match = re.fullmatch(r"(\w+)=([\w.-]+)", override)
        if match and match[2] in folders.options(match[1]):
            files.append(override)
    return files


def _misfit(text: str, override: Override, config: Mapping[str, Any]) -> str:
    key, shown = override.key_or_group, short(text, 120)
    options = folders.options(key) if re.fullmatch(r"\w+", key) else []
    node = _at(config, key)
    if override.is_sweep_override():
        as_list = isinstance(node, list) and re.fullmatch(r"[^\[(]*", text)
        return f"{shown}: takes a list, {key}=[{text.partition('=')[2]}]" if as_list else ""
    if override.is_delete():
        return f"{shown}: " + (
            "there is no such key; leave this word out"
            if node is _ABSENT
            else f"a key cannot be removed; {_settable(key, node)}"
        )
    if text.startswith("+") and (options or node is not _ABSENT):
        return f"{shown}: {key} already has a value; type {text.lstrip('+')}"
    if key.partition(".")[0] == "analysis" and config.get("analysis", _ABSENT) is None:
        return f"{shown}: {ANALYSIS}" if override.value() is not None else ""
    if options:
        return _choice(shown, key, override.value(), options, node)
    if node is _ABSENT:
        above = key.rpartition(".")[0]
        through = _at(config, above) if above else _ABSENT
        group, _, block = above.partition(".")
        if through is None and block.isidentifier() and folders.options(group):
            option = _at(config, f"{group}.name")
            return f"{shown}: {group}={option} has no {above}; use another {group}=NAME"
        leads = through is not _ABSENT and not isinstance(through, dict | None)
        return f"{shown}: {above} has no keys below it; {_settable(above, through)}" if leads else ""
    return _value(shown, key, override.value(), node)


def _choice(shown: str, key: str, value: Any, options: Sequence[str], node: Any) -> str:
    """Return what is wrong with a value that should be the name of a group's option; '' if it is a name."""
    if isinstance(value, str | QuotedString):
        name = value.text if isinstance(value, QuotedString) else value
        path = PurePath(name)
        inside = folders.options(f"{key}/{path.parent}") if len(path.parts) == 2 else []
        if inside:  # a folder of options: algo=suite_2026/NAME
            return (
                f"{shown}: no such option; {closest(name, [f'{path.parent}/{option}' for option in inside])}"
            )
        if "/" in name or path.suffix in (".yaml", ".yml"):
            return f"{shown}: takes a name, not a path; put the file into conf/{key}/{path.stem}.yaml, then {key}={path.stem}"
        return ""
    if isinstance(value, list):
        missing = [str(item) for item in value if str(item) not in options]
        return (
            f"{key}={short(missing[0], 60)}: no such option; {closest(missing[0], options)}"
            if missing
            else ""
        )
    if isinstance(value, dict) or (value is None and key in ("experiment", "search")):
        return ""
    values = (
        f", or {_settable(key, node)}" if isinstance(value, int | float) and isinstance(node, dict) else ""
    )
    return f"{shown}: no such option; valid: {', '.join(options)}{values}"


def _value(shown: str, key: str, value: Any, node: Any) -> str:
    """Return what is wrong with a value of the wrong kind; '' if its kind (block of keys, list, single value) fits the key."""
    if isinstance(node, dict):
        return (
            ""
            if isinstance(value, dict)
            else f"{shown}: {key} is a group of keys, not a value; {_settable(key, node)}"
        )
    if isinstance(node, list):
        if isinstance(value, list) or value is None:
            return ""
        point = len(node) == 3 and all(isinstance(x, int | float) for x in node)
        example = _written(node) if point or value == "" or isinstance(value, dict) else f"[{value}]"
        return f"{shown}: takes a list, for example {key}={example}"
    if isinstance(value, list | dict) and node is not None:
        kind = "a list" if isinstance(value, list) else "keys"
        return f"{shown}: takes one value, not {kind}, for example {key}={_written(node)}"
    return ""


def _settable(key: str, node: Any) -> str:
    """Return a hint on how to set a key or, if the key is a block, the keys in the block."""
    if not isinstance(node, dict):
        return f"type {key}={_written(node)}, for example"
    names = [f"{key}.{name}" for name in node]
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return f"set one of {', '.join(names[:SHOWN])}{more}"


def _written(node: Any) -> str:
    """Return a plain value in the form that a user types."""
    if isinstance(node, list):
        return f"[{','.join(map(_written, node))}]"
    if node is None or isinstance(node, bool):
        return "null" if node is None else str(node).lower()
    return f"{node:g}" if isinstance(node, float) else str(node)


def _at(config: Mapping[str, Any], key: str) -> Any:
    node: Any = config
    for part in key.split("."):
        if not isinstance(node, Mapping) or part not in node:
            return _ABSENT
        node = node[part]
    return node


def plain(config: DictConfig) -> dict[str, Any]:
    """Return the plain values of a composed configuration; interpolations stay text."""
    values = OmegaConf.to_container(config)
    assert isinstance(values, dict)
    return {str(key): value for key, value in values.items()}

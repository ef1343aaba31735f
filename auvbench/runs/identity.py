"""A run is its configuration: the same configuration is the same directory.

The identity is a readable prefix and a short hash of the resolved configuration without the keys that cannot
change the result.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

SCHEMA_VERSION = 1
"""Of the run directory's layout and of the meaning of its configuration; part of every hash."""

NEUTRAL = (
    "name",
    "output",
    "launcher",
    "simulator.threads",
    "train.checkpoint",
    "train.progress",
)
"""Keys that cannot change a run's result: where it lies, how it is launched, saved and watched."""

_DESCRIPTIVE = ("source", "sources", "unit", "title", "remarks", "comment")
"""Entries of a vehicle sheet that describe numbers; a better citation is not another vehicle."""


def relevant(config: Mapping[str, Any]) -> dict[str, Any]:
    """The part of a resolved configuration that determines the result."""
    kept = _without_neutral(config, "")
    if isinstance(kept.get("vehicle"), dict):
        kept["vehicle"] = without_descriptions(kept["vehicle"])
    if kept.get("algo", {}).get("agent") in ("pid", "random"):
        kept.pop("train", None)  # nothing to learn: the budget changes nothing
    return kept


def _without_neutral(node: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    kept: dict[str, Any] = {}
    for key, value in node.items():
        path = f"{prefix}{key}"
        if path in NEUTRAL:
            continue
        kept[str(key)] = _without_neutral(value, f"{path}.") if isinstance(value, Mapping) else value
    return kept


def without_descriptions(node: Any) -> Any:
    """A vehicle sheet without its citations and units: what changes the physics."""
    if isinstance(node, Mapping):
        return {key: without_descriptions(value) for key, value in node.items() if key not in _DESCRIPTIVE}
    if isinstance(node, list):
        return [without_descriptions(value) for value in node]
    return node


def digest(config: Mapping[str, Any]) -> str:
    """Eight hexadecimal digits of the SHA-256 of the relevant configuration."""
    return digest_of({"schema_version": SCHEMA_VERSION, "config": relevant(config)}, 8)


def digest_of(value: Any, digits: int) -> str:
    """The first hexadecimal digits of the SHA-256 of a plain value as canonical JSON."""
    canonical = json.dumps(_numbers(value), sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(canonical.encode()).hexdigest()[:digits]


def _numbers(node: Any) -> Any:
    """Whole floats as integers, so that `1` and `1.0` typed for the same key are the same run."""
    if isinstance(node, dict):
        return {key: _numbers(value) for key, value in node.items()}
    if isinstance(node, list):
        return [_numbers(value) for value in node]
    if isinstance(node, float) and node.is_integer():
        return int(node)
    return node


def run_id(config: Mapping[str, Any]) -> str:
    """`{algorithm}-k{K}-f{frequency}-s{seed}-{hash}`, e.g. ppo-k1-f10-s42-1b2c3d4e."""
    return (
        f"{config['algo']['name']}-k{_short(config['reward']['k'])}-f{_short(config['step']['frequency'])}"
        f"-s{config['seed']}-{digest(config)}"
    )


def _short(value: float) -> str:
    return f"{float(value):g}"

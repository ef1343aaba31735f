"""What the fields of a manifest are: those who read one rely on it, whoever wrote it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from auvbench.untrusted.text import short

STATES = ("pending", "running", "interrupted", "failed", "complete")

SHIPPED = "shipped"
"""true in the manifest of a copy that `auvbench publish` made: rows, and nothing to train on or to test"""


def wrong(manifest: Mapping[str, Any]) -> str:
    """The first field that is missing or of another kind, in words; empty where all are right."""
    for key, (is_right, kind) in _REQUIRED.items():
        if key not in manifest:
            return f"{key} is missing"
        if not is_right(manifest[key]):
            return f"{key} is {short(repr(manifest[key]), 40)}, which is no {kind}"
    for key, (is_right, kind) in _OPTIONAL.items():
        if manifest.get(key) is not None and not is_right(manifest[key]):
            return f"{key} is {short(repr(manifest[key]), 40)}, which is no {kind}"
    if manifest["state"] not in STATES:
        return f"state is {short(manifest['state'], 40)}, valid: {', '.join(STATES)}"
    return ""


def is_count(value: Any) -> bool:
    """A whole number from 0; True is none."""
    return type(value) is int and value >= 0


def is_share(value: Any) -> bool:
    """A number from 0 to 1."""
    return _is_number(value) and 0 <= value <= 1


def _is_number(value: Any) -> bool:
    return type(value) in (int, float) and math.isfinite(value)


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_duration(value: Any) -> bool:
    return _is_number(value) and 0 <= value <= 1e12


def _is_error(value: Any) -> bool:
    if value is None:
        return True
    return (
        isinstance(value, dict)
        and isinstance(value.get("message", ""), str)
        and (value.get("step") is None or is_count(value["step"]))
    )


def _is_phases(value: Any) -> bool:
    return isinstance(value, dict) and all(_is_duration(seconds) for seconds in value.values())


_Rule = tuple[Callable[[Any], bool], str]

_REQUIRED: dict[str, _Rule] = {
    "state": (_is_text, "text"),
    "algo": (_is_text, "text"),
    "seed": (is_count, "whole number from 0"),
    "steps": (is_count, "whole number from 0"),
    "total_steps": (is_count, "whole number from 0"),
    "attempts": (is_count, "whole number from 0"),
    "wall_time_s": (_is_duration, "number of seconds"),
    "error": (_is_error, "error"),
    "id": (_is_text, "text"),
}

_OPTIONAL: dict[str, _Rule] = {
    "episodes": (is_count, "whole number from 0"),
    "success_rate": (is_share, "number from 0 to 1"),
    "created": (_is_text, "text"),
    "started": (_is_text, "text"),
    "ended": (_is_text, "text"),
    "command": (_is_text, "text"),
    "phases": (_is_phases, "table of seconds"),
    "cpu_time_s": (_is_duration, "number of seconds"),
    "versions": (lambda value: isinstance(value, dict), "table"),
    "git": (lambda value: isinstance(value, dict), "table"),
    "host": (lambda value: isinstance(value, dict), "table"),
    SHIPPED: (lambda value: isinstance(value, bool), "true or false"),
}

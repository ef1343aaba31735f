"""Interpolations such as `${oc.env:SCRATCH}` in the configuration of a run.

They are resolved when a run is made. In a run from another person such a text would read the environment of the user who
resumes or tests it, and store the value.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from auvbench.untrusted.text import short


def first(config: Mapping[str, Any]) -> str:
    """Return the first text that would be resolved, as `key is text`; empty without one."""
    waiting: list[tuple[str, Any]] = [("", config)]
    while waiting:
        path, node = waiting.pop()
        if isinstance(node, Mapping):
            waiting += [(f"{path}.{key}" if path else str(key), child) for key, child in node.items()]
        elif isinstance(node, list):
            waiting += [(f"{path}[{index}]", child) for index, child in enumerate(node)]
        elif isinstance(node, str) and "${" in node:
            return f"{short(path)} is {short(repr(node), 60)}"
    return ""

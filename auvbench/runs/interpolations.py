"""Interpolations in a configuration that is to be frozen, or was.

Who makes a run resolves `${oc.env:SCRATCH}` once and stores what it stood for. In a run from a stranger such a text
would read the environment of whoever resumes or tests it, and store that in turn.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from auvbench.untrusted.text import short


def first(config: Mapping[str, Any]) -> str:
    """The first text that would be resolved, as `key is text`; empty where there is none."""
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

"""Parts of SDF text: exact numbers, plugins, and comments with a number's sources."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any

Cite = Callable[..., str]
"""Returns the comment with the sources of a number, for its path of keys in a sheet."""


def citations(sheet: Mapping[str, Any]) -> Cite:
    """Return a `Cite` for a sheet."""

    def cite(*path: str) -> str:
        node: Any = sheet
        for key in path:
            node = node.get(key) if isinstance(node, Mapping) else None
        named = node.get("source") if isinstance(node, Mapping) else None
        if named is None:
            return ""
        text = ", ".join(named) if isinstance(named, list | tuple) else str(named)
        return f"  <!-- {comment(text)} -->"

    return cite


def no_citations(*path: str) -> str:
    """Return no comment: for models that only the simulator reads."""
    return ""


def comment(text: str) -> str:
    """Return `text` as an XML comment may hold it."""
    return re.sub("-{2,}", "-", text)


def plugin(library: str, name: str, *body: str) -> str:
    """Return a `<plugin>` element of one of Gazebo's systems, indented by two blanks."""
    opening = f'  <plugin filename="gz-sim-{library}-system" name="gz::sim::systems::{name}"'
    if not body:
        return f"{opening}/>"
    return "\n".join([f"{opening}>", *(f"    {line}" for line in body), "  </plugin>"])


def number(value: float) -> str:
    """Return the shortest decimal that reads back as the same double."""
    value = float(value) + 0.0  # no negative zero
    return str(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)


def numbers(values: Any) -> str:
    """Return numbers with blanks between them."""
    return " ".join(number(value) for value in values)

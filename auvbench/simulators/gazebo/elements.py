"""Pieces of SDF text: numbers that read back as they were, plugins, and comments that name a number's sources."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any

Cite = Callable[..., str]
"""Gives, for a path of keys in a sheet, the comment that names the sources of the number there."""


def citations(sheet: Mapping[str, Any]) -> Cite:
    """A function from a path of keys in a sheet to the comment that names the sources of the number there."""

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
    """For models that nobody reads."""
    return ""


def comment(text: str) -> str:
    """`text` as it may stand in an XML comment."""
    return re.sub("-{2,}", "-", text)


def plugin(library: str, name: str, *body: str) -> str:
    """A `<plugin>` element of one of Gazebo's own systems, two blanks deep."""
    opening = f'  <plugin filename="gz-sim-{library}-system" name="gz::sim::systems::{name}"'
    if not body:
        return f"{opening}/>"
    return "\n".join([f"{opening}>", *(f"    {line}" for line in body), "  </plugin>"])


def number(value: float) -> str:
    """The shortest decimal that reads back as the same double."""
    value = float(value) + 0.0  # no negative zero
    return str(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)


def numbers(values: Any) -> str:
    """Numbers with blanks between them."""
    return " ".join(number(value) for value in values)

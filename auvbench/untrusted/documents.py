"""JSON and YAML from elsewhere, bounded before anything recurses into them.

PyYAML's C loader composes recursively without a bound: 100,000 brackets end the process. Aliases make a document
of a few hundred bytes stand for billions of values ("billion laughs"). So nesting and expansion are counted on
the stream of parsing events, which needs no recursion, before a document is built.
"""

from __future__ import annotations

import contextlib
import re
from typing import Any

import yaml

from auvbench.untrusted.json_text import DEPTH, TOO_DEEP, WHOLE, json_value

__all__ = ["DEPTH", "NODES", "WHOLE", "check_yaml", "json_value", "no_yaml", "yaml_value"]

NODES = 1_000_000
"""values that a document holds, with every alias counted as what it stands for"""

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_INDENT = re.compile(rb"^[ \-?:]*", re.MULTILINE)


_ENDLESS = "nested without end: an alias stands for what holds it"


def yaml_value(data: bytes) -> Any:
    """A YAML value of bounded depth and size, by the safe loader.

    Raises:
        ValueError: what is wrong with it, in one line.
    """
    try:
        if not _is_shallow(data):
            check_yaml(data)
        return yaml.load(data, Loader=_LOADER)
    except yaml.YAMLError as error:
        raise ValueError(no_yaml(error)) from error
    except RecursionError:
        raise ValueError(TOO_DEEP) from None


def check_yaml(data: bytes) -> None:
    """Refuses YAML that is nested too deep or stands for too much; what is no YAML is left to those who load it.

    Raises:
        ValueError: in one line.
    """
    with contextlib.suppress(yaml.YAMLError):
        _count(data)


def no_yaml(error: yaml.YAMLError) -> str:
    """What is wrong with a text that is no YAML, in one line."""
    mark = getattr(error, "problem_mark", None)
    line = f"line {mark.line + 1}: " if mark is not None else ""
    return f"{line}{getattr(error, 'problem', None) or 'not valid YAML'}"


def _is_shallow(data: bytes) -> bool:
    """Whether counting characters tells already that it can neither be deep nor repeat itself.

    A level takes a bracket, or a blank or dash before what stands in its line. Counting events takes as long as
    loading, and a report loads a thousand configurations.
    """
    if b"*" in data:
        return False
    flow = data.count(b"[") + data.count(b"{")
    indent = max((len(found) for found in _INDENT.findall(data)), default=0)
    return flow + indent <= DEPTH


def _count(data: bytes) -> None:
    sizes: dict[str, int] = {}  # of what has an anchor
    # Open collections: the anchor's name, and the values below so far.
    stack: list[tuple[str | None, int]] = []
    total = 0
    for event in yaml.parse(data, Loader=_LOADER):
        if isinstance(event, yaml.MappingStartEvent | yaml.SequenceStartEvent):
            if len(stack) >= DEPTH:
                raise ValueError(TOO_DEEP)
            stack.append((event.anchor, 1))
            continue
        if isinstance(event, yaml.MappingEndEvent | yaml.SequenceEndEvent):
            anchor, size = stack.pop()
        elif isinstance(event, yaml.AliasEvent):
            anchor = None
            if event.anchor in (name for name, _ in stack):
                raise ValueError(_ENDLESS)
            size = sizes.get(event.anchor or "", 1)  # of no anchor at all: the loader says so
        elif isinstance(event, yaml.ScalarEvent):
            anchor, size = event.anchor, 1
        else:
            continue
        if anchor is not None:
            sizes[anchor] = size
        if stack:
            name, below = stack[-1]
            stack[-1] = (name, below + size)
        total = max(total, size, stack[-1][1] if stack else 0)
        if total > NODES:
            raise ValueError(f"its aliases stand for more than {NODES:,} values")

"""JSON from elsewhere, bounded: of limited depth, and without what no counter or measurement gives."""

from __future__ import annotations

import json
import math
from typing import Any, NoReturn

DEPTH = 100
"""levels of nesting; a run's configuration has six"""
WHOLE = 2**64
"""whole numbers beyond this are no count of anything"""

TOO_DEEP = f"it is nested more than {DEPTH} levels deep"


def json_value(data: bytes | str, *, whole: int = WHOLE) -> Any:
    """A JSON value of bounded depth, without NaN, infinities and numbers that no counter reaches.

    Args:
        data: the text.
        whole: the largest whole number that has a meaning there; the state of a generator has 128 bits.

    Raises:
        ValueError: what is wrong with it, in one line.
    """
    try:
        value = json.loads(data, parse_constant=_no_constant)
    except RecursionError:
        raise ValueError(TOO_DEEP) from None
    level: list[Any] = [value]
    for _ in range(DEPTH):
        following: list[Any] = []
        for node in level:
            if isinstance(node, dict):
                following += node.values()
            elif isinstance(node, list):
                following += node
            elif isinstance(node, float) and not math.isfinite(node):
                raise ValueError("a number in it is too large")
            elif isinstance(node, int) and abs(node) > whole:
                raise ValueError("a whole number in it is too large")
        if not following:
            return value
        level = following
    raise ValueError(TOO_DEEP)


def _no_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is no JSON")

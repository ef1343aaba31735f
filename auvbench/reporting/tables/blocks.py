"""Columns that do not fit beside each other, in several tables."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from itertools import groupby
from typing import TypeVar

T = TypeVar("T")


def blocks(
    columns: Sequence[T], width: Callable[[T], float], room: float, group: Callable[[T], Hashable]
) -> list[list[T]]:
    """The columns in as few tables of a width as keep those of one group together where they can.

    Args:
        columns: in their order.
        width: of a column.
        room: that the columns of a table have.
        group: of a column; neighbours of one group are kept together.
    """
    result: list[list[T]] = [[]]
    left = room
    for _, members in groupby(columns, key=group):
        levels = list(members)
        needed = sum(map(width, levels))
        for column in levels:
            if result[-1] and (width(column) > left or (column is levels[0] and left < needed <= room)):
                result.append([])
                left = room
            result[-1].append(column)
            left -= width(column)
    return result

"""Splitting a wide table into several that fit."""

from __future__ import annotations

from collections.abc import Callable
from itertools import groupby

from auvbench.reporting.tables.table import Table


def split(table: Table, width: Callable[[int], float], room: float) -> list[list[int]]:
    """Return the columns of each part of a table, as indices; every part begins with the lead columns.

    Args:
        table: the columns in their order; neighbours of one `Heading.group` stay together where they can.
        width: of a column.
        room: that all columns of a part have together.
    """
    lead = list(range(table.lead))
    whole = room - sum(map(width, lead))
    parts: list[list[int]] = [list(lead)]
    left = whole
    columns = range(table.lead, len(table.headings))
    for _, members in groupby(columns, key=lambda i: table.headings[i].group or i):
        found = list(members)
        needed = sum(map(width, found))
        for i in found:
            full = width(i) > left or (i == found[0] and left < needed <= whole)
            if full and len(parts[-1]) > table.lead:
                parts.append(list(lead))
                left = whole
            parts[-1].append(i)
            left -= width(i)
    return parts

"""Success by condition as the page shows it: the ranked table with conditions in the place of metrics."""

from __future__ import annotations

from collections.abc import Mapping

from auvbench.analysis.model import Ranking
from auvbench.reporting.page.links import Links
from auvbench.reporting.page.table import Heading, Table, part_of, room_of, table_of, width_of
from auvbench.reporting.tables.blocks import blocks
from auvbench.reporting.tables.conditions import by_condition, factor


def tables(ranking: Ranking, colours: Mapping[str, str], links: Links) -> list[Table]:
    """As many tables as the page's width asks for; none where the protocol has one condition."""
    if not ranking.conditions:
        return []
    rows, columns = by_condition(ranking)
    headings = [
        Heading(
            column.metric,
            column.title[:1].upper() + column.title[1:],
            column.unit,
            column.metric,
            column.scale,
        )
        for column in columns
    ]
    whole = table_of(rows, headings, colours, links)
    parts = blocks(
        range(len(headings)), lambda i: width_of(whole, i), room_of(whole), lambda i: factor(columns[i])
    )
    return [part_of(whole, part) for part in parts]

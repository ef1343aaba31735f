"""Success by condition as the page shows it: the ranked table with conditions in the place of metrics."""

from __future__ import annotations

from collections.abc import Mapping

from auvbench.analysis.model import Ranking
from auvbench.reporting.page.links import Links
from auvbench.reporting.page.table import Heading, Table, table_of
from auvbench.reporting.tables.conditions import by_condition


def table(ranking: Ranking, colours: Mapping[str, str], links: Links) -> Table | None:
    """None where the protocol has one condition."""
    if not ranking.conditions:
        return None
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
    return table_of(rows, headings, colours, links)

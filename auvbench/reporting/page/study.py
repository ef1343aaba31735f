"""A study's own table next to ours, as the page shows it: two lines per agent, theirs and ours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from auvbench.reporting.page import numbers
from auvbench.reporting.page.links import Links

if TYPE_CHECKING:
    from auvbench.analysis.study import ComparisonRow


@dataclass(frozen=True, slots=True)
class Pair:
    """One measure of one agent: theirs and ours."""

    theirs: str
    their_interval: str
    mark: str
    ours: str
    our_interval: str


@dataclass(frozen=True, slots=True)
class Line:
    """One agent of the study."""

    name: str
    label: str
    """ours; '' where it was not run"""
    colour: str
    href: str
    pairs: tuple[Pair | None, ...]
    """in the order of the titles; None where the study has no number"""


@dataclass(frozen=True, slots=True)
class Table:
    """A study's table next to ours."""

    titles: tuple[str, ...]
    lines: tuple[Line, ...]
    marks: tuple[str, ...]
    """those that occur and need a word of explanation"""


MARKS = {
    "r": "restored from the sums of its row",
    "text": "given in the text, not in the table",
}


def table(rows: Sequence[ComparisonRow], colours: Mapping[str, str], links: Links) -> Table | None:
    """None where there is nothing to compare."""
    titles = {row.measure: row.title for row in rows}
    lines = []
    for name in dict.fromkeys(row.agent for row in rows):
        mine = {row.measure: row for row in rows if row.agent == name}
        label = next(iter(mine.values())).label
        pairs = tuple(_pair(mine[measure]) if measure in mine else None for measure in titles)
        lines.append(Line(name, label, colours.get(label, ""), links.of_agent(label), pairs))
    marks = tuple(mark for mark in MARKS if any(row.mark == mark for row in rows))
    return (
        Table(tuple(title[:1].upper() + title[1:] for title in titles.values()), tuple(lines), marks)
        if lines
        else None
    )


def _pair(row: ComparisonRow) -> Pair:
    places = 1 if row.thesis_interval else 2
    their_interval = ""
    if row.thesis_interval is not None:
        low, high = (numbers.fixed(bound, 1) for bound in row.thesis_interval)
        their_interval = f"{low} – {high}"
    ours, our_interval = ("", "") if row.ours is None else numbers.estimate(row.ours)
    theirs = numbers.fixed(row.thesis, 0 if abs(row.thesis) >= 1000 else places)
    return Pair(theirs, their_interval, row.mark, ours, our_interval)

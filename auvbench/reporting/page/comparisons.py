"""Comparisons of two agents as the page shows them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from auvbench.analysis.model import Comparison
from auvbench.reporting.page import numbers
from auvbench.reporting.page.table import heading_of, sortable


@dataclass(frozen=True, slots=True)
class Pair:
    """One comparison, printed."""

    first: str
    second: str
    metric: str
    difference: str
    interval: str
    difference_sort: float | None
    p_adjusted: str
    p_sort: float | None
    verdict: str
    improvement: str
    improvement_interval: str
    improvement_sort: float | None
    resolved: bool


def pairs(comparisons: Iterable[Comparison], *, alpha: float = 0.05) -> list[Pair]:
    """The comparisons; differences of rates in percentage points; resolved where the adjusted p is below alpha."""
    found = []
    for comparison in comparisons:
        heading = heading_of(comparison.metric)
        unit = "points" if heading.rate else heading.unit
        difference, interval = numbers.estimate(comparison.difference, heading.scale)
        improvement, improvement_interval = numbers.estimate(comparison.probability_of_improvement)
        found.append(
            Pair(
                first=comparison.first,
                second=comparison.second,
                metric=f"{heading.title} ({unit})" if unit else heading.title,
                difference=difference
                if difference[0] in (numbers.MINUS + numbers.NOTHING)
                else f"+{difference}",
                interval=interval,
                difference_sort=sortable(comparison.difference.value),
                p_adjusted=numbers.p_value(comparison.p_adjusted),
                p_sort=sortable(comparison.p_adjusted),
                verdict=comparison.verdict,
                improvement=improvement,
                improvement_interval=improvement_interval,
                improvement_sort=sortable(comparison.probability_of_improvement.value),
                resolved=comparison.p_adjusted < alpha,
            )
        )
    return found

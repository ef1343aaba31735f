"""Format numbers and lists for tables and sentences.

Numbers are rounded by the rule of metrology (JCGM 100:2008, 7.2.6). The uncertainty is the longer arm of the
interval; it has two significant digits, and the value has the same number of decimal places.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from auvbench.analysis.measures import UNKNOWN, Measure, metric_of
from auvbench.statistics.intervals import Estimate

NOTHING = "–"
"""text for a number that does not exist (the time to goal of an agent that never arrives)"""


def decimals(half_width: float) -> int:
    """Return the decimal places at which `half_width` has two significant digits; negative for tens and
    hundreds.

    >>> decimals(1.34), decimals(0.0991), decimals(12.0), decimals(345.0), decimals(0.0996)
    (1, 3, 0, -1, 2)
    """
    # Round first: 0.0996 becomes 0.10, whose second digit is one place further left.
    return 1 - math.floor(math.log10(float(f"{half_width:.1e}")))


def fixed(value: float, places: int) -> str:
    """Return `value` with `places` decimal places; negative `places` round to tens or hundreds. Zero has no sign.

    >>> fixed(1234.5, -1), fixed(2.005, 1), fixed(-0.01, 1)
    ('1230', '2.0', '0.0')
    """
    if not math.isfinite(value):
        return NOTHING
    text = f"{round(value, places):.{max(places, 0)}f}"
    return text.removeprefix("-") if float(text) == 0 else text


def significant(value: float, digits: int = 4) -> str:
    """Return `value` with `digits` significant digits, for a number without an interval.

    >>> significant(3.14159), significant(12345.6), significant(0.0)
    ('3.142', '12350', '0')
    """
    if not math.isfinite(value):
        return NOTHING
    return "0" if value == 0 else fixed(value, digits - 1 - math.floor(math.log10(abs(value))))


def rounded(estimate: Estimate, scale: float = 1.0) -> tuple[str, str, str]:
    """Return value, lower and upper bound as text, rounded to the same place.

    Args:
        estimate: value with its interval.
        scale: factor to apply first (100 for percent, 1e-3 for kJ).

    Returns:
        Three strings; the bounds are empty without an interval (one episode, no spread).
    """
    value, low, high = (scale * x for x in (estimate.value, estimate.low, estimate.high))
    half = max(value - low, high - value)
    if not math.isfinite(value):
        return NOTHING, "", ""
    if not math.isfinite(half) or half <= abs(value) * 1e-12:
        return significant(value), "", ""
    places = min(decimals(half), 6)
    return fixed(value, places), fixed(low, places), fixed(high, places)


def name(m: Measure) -> str:
    """Return a measure's name for a sentence.

    >>> from auvbench.analysis.measures import measure
    >>> name(measure("success_rate")), name(measure("mean_deviation_mean_m")), name(measure("mean_smoothness_per_s"))
    ('success rate', 'deviation', 'smoothness')
    """
    if m.penalty:
        return f"PAR-{m.penalty:.0f} {'steps' if m.column == 'steps' else 'time'}"
    metric = metric_of(m.column)
    return (m.name if m.rate else m.column).replace("_", " ") if metric is None else metric.title


def unit(m: Measure) -> str:
    """Return a measure's unit, with a space in front; '' without a unit.

    >>> from auvbench.analysis.measures import measure
    >>> unit(measure("success_rate")), unit(measure("mean_energy_J")), unit(measure("mean_smoothness_per_s"))
    (' %', ' J', '/s')
    >>> unit(measure("par1_steps")), unit(measure("par1_time_s"))
    (' steps', ' s')
    """
    if m.rate:
        return " %"
    if m.column == "steps":
        return " steps"
    symbol = (metric_of(m.column) or UNKNOWN).unit
    return "/s" if symbol == "1/s" else f" {symbol}" if symbol else ""


def unit_of_difference(m: Measure) -> str:
    """Return the unit of a measure's difference, with a space in front: points for rates."""
    return " points" if m.rate else unit(m)


def amount(estimate: Estimate, m: Measure) -> str:
    """Return a value with its interval: '97.2 % [95.3, 98.4]'."""
    value, low, high = rounded(estimate, m.scale)
    return f"{value}{unit(m)}" + (f" [{low}, {high}]" if low else "")


def size(value: float, m: Measure) -> str:
    """Return a difference without sign and interval: '2 points', '1.1 s'.

    >>> from auvbench.analysis.measures import measure
    >>> size(0.02, measure("success_rate")), size(10.99, measure("par1_steps")), size(1.099, measure("par1_time_s"))
    ('2 points', '11 steps', '1.1 s')
    """
    return f"{significant(m.scale * abs(value), 2)}{unit_of_difference(m)}".replace(".0 ", " ")


def difference(estimate: Estimate, m: Measure) -> str:
    """Return a difference with its interval and sign: '+3.1 points [1.0, 5.2]' for a rate."""
    value, low, high = rounded(estimate, m.scale)
    sign = "+" if estimate.value > 0 and not value.startswith("-") else ""
    return f"{sign}{value}{unit_of_difference(m)}" + (f" [{low}, {high}]" if low else "")


def rounded_difference(estimate: Estimate, m: Measure) -> tuple[str, str]:
    """Return the size of a difference and its interval, both without the sign of the difference.

    >>> from auvbench.analysis.measures import measure
    >>> rounded_difference(Estimate(-28.0, -29.46, -26.5), measure("par1_steps"))
    ('28.0 steps', ' [26.5, 29.5]')
    """
    away = estimate if estimate.value > 0 else turned(estimate)
    value, low, high = rounded(away, m.scale)
    return f"{value}{unit_of_difference(m)}", f" [{low}, {high}]" if low else ""


def turned(estimate: Estimate) -> Estimate:
    """Return a difference, and the limits of its interval, with reversed sign."""
    return replace(estimate, value=-estimate.value, low=-estimate.high, high=-estimate.low)


def listed(items: Sequence[str], most: int = 5) -> str:
    """Return a list in words, shortened if it is long.

    >>> listed(["a", "b", "c"]), listed(list("abcdefgh"), most=3)
    ('a, b and c', 'a, b, c and 5 more')
    """
    if len(items) > most + 1:
        return f"{', '.join(items[:most])} and {len(items) - most} more"
    *first, last = items or [""]
    return f"{', '.join(first)} and {last}" if first else last


def counted(n: int, noun: str) -> str:
    """Return a number with its noun.

    >>> counted(1, "seed"), counted(3, "seed")
    ('1 seed', '3 seeds')
    """
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"


def capitalized(text: str) -> str:
    """Return a text with a capital first letter."""
    return f"{text[:1].upper()}{text[1:]}"


def p_value(p: float) -> str:
    """Return a p-value as text.

    >>> p_value(0.04321), p_value(0.00001)
    ('p = 0.043', 'p < 0.001')
    """
    return "p < 0.001" if p < 0.001 else f"p = {p:.3f}" if p < 0.0995 else f"p = {p:.2f}"

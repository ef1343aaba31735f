"""Round numbers by their uncertainty.

The rule of metrology (JCGM 100:2008, 7.2.6): the uncertainty keeps two significant digits, and the value is rounded to the
same decimal place. The uncertainty is the longer arm of the interval.
"""

from __future__ import annotations

import math

from auvbench.statistics.intervals import Estimate

NOTHING = "–"
"""a number that does not exist (the time to goal of an agent that never arrived)"""


def decimals(half_width: float, digits: int = 2) -> int:
    """Return the decimal places at which `half_width` keeps its significant digits; negative for tens and hundreds.

    >>> decimals(1.34), decimals(0.0991), decimals(12.0), decimals(345.0), decimals(0.0996)
    (1, 3, 0, -1, 2)
    """
    # Rounding first: 0.0996 becomes 0.10, whose second digit stands one place further left.
    rounded = float(f"{half_width:.{digits - 1}e}")
    return digits - 1 - math.floor(math.log10(rounded))


def fixed(value: float, places: int) -> str:
    """Return `value` at some decimal places; negative places round tens and hundreds, and zero has no sign.

    >>> fixed(1234.5, -1), fixed(2.005, 1), fixed(-0.01, 1)
    ('1230', '2.0', '0.0')
    """
    if not math.isfinite(value):
        return NOTHING
    text = f"{round(value, places):.{max(places, 0)}f}"
    return text.removeprefix("-") if float(text) == 0 else text


def significant(value: float, digits: int = 4) -> str:
    """Return `value` to some significant digits, for a number without an interval.

    >>> significant(3.14159), significant(12345.6), significant(0.0)
    ('3.142', '12350', '0')
    """
    if not math.isfinite(value):
        return NOTHING
    return "0" if value == 0 else fixed(value, digits - 1 - math.floor(math.log10(abs(value))))


def rounded(estimate: Estimate, scale: float = 1.0) -> tuple[str, str, str]:
    """Return value, lower and upper bound as text, rounded to the same place.

    Args:
        estimate: the value and its interval.
        scale: a factor applied first (100 for percent, 1e-3 for kJ).

    Returns:
        three strings; the bounds are empty without an interval (one episode, no spread).
    """
    value, low, high = (scale * x for x in (estimate.value, estimate.low, estimate.high))
    half = max(value - low, high - value)
    if not math.isfinite(value):
        return NOTHING, "", ""
    if not math.isfinite(half) or half <= abs(value) * 1e-12:
        return significant(value), "", ""
    places = min(decimals(half), 6)
    return fixed(value, places), fixed(low, places), fixed(high, places)

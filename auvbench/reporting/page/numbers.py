"""Numbers as the page prints them: rounded as everywhere in a report, set with typographic signs."""

from __future__ import annotations

import math
import re

from auvbench.analysis import rounding
from auvbench.statistics.estimate import Estimate

NOTHING = rounding.NOTHING
MINUS = "−"
_THIN = "\u202f"
"""narrow no-break space: parts thousands and stands before a unit"""


def fixed(value: float | None, places: int) -> str:
    """The value with so many decimals; a dash where there is none.

    >>> fixed(-1234.56, 1), fixed(None, 1)
    ('−1234.6', '–')
    """
    return NOTHING if value is None else typeset(rounding.fixed(value, places))


def estimate(of: Estimate, scale: float = 1.0) -> tuple[str, str]:
    """Value and interval: ('98.0', '96.4 – 98.9'); the interval is '' where there is none.

    >>> estimate(Estimate(0.98, 0.964, 0.989), 100.0)
    ('98.0', '96.4 – 98.9')
    """
    value, low, high = (typeset(text) for text in rounding.rounded(of, scale))
    between = " to " if low.startswith(MINUS) else " – "  # a dash next to a minus sign is hard to read
    return value, f"{low}{between}{high}" if low else ""


def typeset(number: str) -> str:
    """A real minus sign, and thousands parted by a narrow space from five digits on."""
    sign = MINUS if number.startswith("-") else ""
    whole, point, rest = number.removeprefix("-").partition(".")
    if whole.isdecimal() and len(whole) > 4:
        whole = f"{int(whole):,}".replace(",", _THIN)
    return sign + whole + point + rest


def minus(sentence: str) -> str:
    """The sentence with real minus signs before its numbers; dates, names and ranges keep their hyphens.

    >>> minus("-4.1 points [-6.7, -1.5] of run sac-1, 10-20 m")
    '−4.1 points [−6.7, −1.5] of run sac-1, 10-20 m'
    """
    return re.sub(r"(?<![\w.)\]-])-(?=\.?\d)", MINUS, sentence)


def duration(seconds: float | None) -> str:
    """A length of time as one says it.

    >>> duration(42240.0), duration(250.0), duration(12.34)
    ('11 h 44 min', '4 min 10 s', '12.3 s')
    """
    if seconds is None or not math.isfinite(seconds) or seconds < 0:
        return NOTHING
    if seconds < 59.95:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    minutes = round(seconds / 60)
    return f"{minutes // 60} h {minutes % 60} min"

"""Numbers as the page prints them: rounded as in all tables, with typographic signs."""

from __future__ import annotations

import re

from auvbench.analysis import rounding
from auvbench.statistics.estimate import Estimate

NOTHING = rounding.NOTHING
MINUS = "−"
_THIN = "\u202f"
"""narrow no-break space: parts thousands and stands before a unit"""


def fixed(value: float | None, places: int) -> str:
    """Return the value with so many decimals; a dash for a missing one.

    >>> fixed(-1234.56, 1), fixed(None, 1)
    ('−1234.6', '–')
    """
    return NOTHING if value is None else typeset(rounding.fixed(value, places))


def estimate(of: Estimate, scale: float = 1.0) -> tuple[str, str]:
    """Return value and interval; the interval may be ''.

    >>> estimate(Estimate(0.98, 0.964, 0.989), 100.0)
    ('98.0', '96.4 – 98.9')
    """
    value, low, high = (typeset(text) for text in rounding.rounded(of, scale))
    between = " to " if low.startswith(MINUS) else " – "  # a dash next to a minus sign is hard to read
    return value, f"{low}{between}{high}" if low else ""


def typeset(number: str) -> str:
    """Return the number with a real minus sign; a narrow space parts thousands from five digits on."""
    sign = MINUS if number.startswith("-") else ""
    whole, point, rest = number.removeprefix("-").partition(".")
    if whole.isdecimal() and len(whole) > 4:
        whole = f"{int(whole):,}".replace(",", _THIN)
    return sign + whole + point + rest


def minus(sentence: str) -> str:
    """Return the sentence with real minus signs; dates, names and ranges keep their hyphens.

    >>> minus("-4.1 points [-6.7, -1.5] of run sac-1, 10-20 m")
    '−4.1 points [−6.7, −1.5] of run sac-1, 10-20 m'
    """
    return re.sub(r"(?<![\w.)\]-])-(?=\.?\d)", MINUS, sentence)

"""Numbers as the page prints them: rounded by their uncertainty, with typographic minus signs."""

from __future__ import annotations

import math

from auvbench.reporting.model import Estimate

DASH = "–"
MINUS = "−"


def decimals(estimate: Estimate, factor: float = 1.0) -> int:
    """Decimal places that show two significant digits of the interval's half-width, at most 4."""
    half = abs(estimate.high - estimate.low) * factor / 2
    if not math.isfinite(half) or half == 0:
        return 1
    return min(4, max(0, 1 - math.floor(math.log10(half))))


def fixed(value: float | None, places: int) -> str:
    """The value with so many decimals; a dash where there is none."""
    if value is None or not math.isfinite(value):
        return DASH
    text = f"{value:,.{places}f}".replace(",", "\u202f")
    if text.startswith("-"):
        text = text[1:] if float(f"{value:.{places}f}") == 0 else MINUS + text[1:]
    return text


def value(estimate: Estimate, factor: float = 1.0) -> str:
    return fixed(estimate.value * factor, decimals(estimate, factor))


def interval(estimate: Estimate, factor: float = 1.0) -> str:
    """'94.1 – 98.9'; '' where there is no interval."""
    if not (math.isfinite(estimate.low) and math.isfinite(estimate.high)):
        return ""
    places = decimals(estimate, factor)
    return f"{fixed(estimate.low * factor, places)} {DASH} {fixed(estimate.high * factor, places)}"


def probability(p: float) -> str:
    """Two decimals, and never 0 or 1 for what is only close to them."""
    if not math.isfinite(p):
        return DASH
    if p < 0.005:
        return "< 0.01"
    return "> 0.99" if p > 0.995 else f"{p:.2f}"


def p_value(p: float) -> str:
    if not math.isfinite(p):
        return DASH
    if p < 0.001:
        return "< 0.001"
    return f"{p:.3f}"


def duration(seconds: float | None) -> str:
    """'11 h 44 min', '4 min 10 s', '12.3 s'."""
    if seconds is None or not math.isfinite(seconds) or seconds < 0:
        return DASH
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes = round(seconds / 60)
    if minutes >= 60:
        return f"{minutes // 60} h {minutes % 60} min"
    whole = round(seconds)
    return f"{whole // 60} min {whole % 60} s"

"""A number with its interval: what the functions of this room return and every table shows."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number and its interval."""

    value: float
    low: float
    high: float
    confidence: float = 0.95
    covers: str = "test episodes"
    """what the interval covers: 'test episodes' (one training seed) or 'training seeds and test episodes'"""

"""One line of the verification page."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Case:
    """An expected number, how the simulator's is obtained, and how far apart they may be."""

    section: str
    name: str
    source: str
    expected: float
    got: Callable[[], float]
    tolerance: float
    unit: str = ""
    relative: bool = False
    """The tolerance is a share of the expected value instead of a difference."""
    relation: str = "="
    """`=`: within the tolerance; `>` or `<`: a bound, as some of the sources' tests state it."""

    @property
    def key(self) -> str:
        return f"{self.section}: {self.name}"

    def passes(self, got: float) -> bool:
        if self.relation == ">":
            return bool(got > self.expected)
        if self.relation == "<":
            return bool(got < self.expected)
        scale = abs(self.expected) if self.relative else 1.0
        return bool(np.isfinite(got) and abs(got - self.expected) <= self.tolerance * scale)

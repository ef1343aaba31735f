"""How a check of the conformance suites fails."""

from __future__ import annotations

from typing import Any

import numpy as np


class ConformanceError(AssertionError):
    """An agent or a simulator breaks its contract; the message names it and says how."""


def same(first: Any, second: Any, what: str) -> None:
    """Raises `ConformanceError` unless two arrays have the same shape, type and bits."""
    a, b = np.asarray(first), np.asarray(second)
    if a.shape != b.shape or a.dtype != b.dtype:
        raise ConformanceError(f"{what}: {a.dtype}{a.shape} and {b.dtype}{b.shape}")
    if a.tobytes() != b.tobytes():
        differing = np.nonzero(~((a == b) | ((a != a) & (b != b))))
        where = (
            ", ".join(str(int(index[0])) for index in differing)
            if differing and len(differing[0])
            else "sign of a zero"
        )
        largest = float(np.max(np.abs(a.astype(np.float64) - b.astype(np.float64))))
        raise ConformanceError(f"{what}: they differ by up to {largest:.3g}, first at [{where}]")

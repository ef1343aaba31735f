"""Two texts with the same words and, but for rounding, the same numbers: tables, JSON, pages."""

from __future__ import annotations

import re

import pytest

NUMBER = re.compile(r"((?<![\w.-])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?![\w.-]))")
"""one that stands by itself: not the digits of a date, a version or a run's id"""


def assert_same_numbers(one: str, other: str, rel: float = 3e-3, abs: float = 1e-5) -> None:
    """Words, and what stands between numbers, must be equal; numbers to `rel` or `abs`.

    The defaults are for what is computed from rows of four significant digits: an end of a wide interval may lie near zero.
    """
    here, there = NUMBER.split(one), NUMBER.split(other)
    assert here[::2] == there[::2]
    assert [float(n) for n in here[1::2]] == pytest.approx(
        [float(n) for n in there[1::2]], rel=rel, abs=abs, nan_ok=True
    )

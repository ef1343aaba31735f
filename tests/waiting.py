"""Wait for events under one generous limit: no test depends on how busy the machine is."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

import pytest

LIMIT = 300.0
"""s; far longer than any awaited event takes on a loaded machine, so that only a hang reaches it"""

T = TypeVar("T")


def until(condition: Callable[[], T], event: str = "the awaited event") -> T:
    """Return the first true value of `condition`, which is asked again and again.

    Args:
        condition: must be cheap and free of side effects.
        event: names what is awaited in the message of a failure.
    """
    end = time.monotonic() + LIMIT
    while not (found := _asked(condition)):
        if time.monotonic() > end:
            pytest.fail(f"{event} did not happen within {LIMIT:g} s")
        time.sleep(0.02)
    return found


def _asked(condition: Callable[[], T]) -> T | None:
    """Return the condition; None where a folder that it lists is renamed at that moment."""
    try:
        return condition()
    except FileNotFoundError:
        return None

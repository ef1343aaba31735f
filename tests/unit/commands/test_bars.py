"""The bar of a single run at the widths of real terminals."""

from __future__ import annotations

import time

import pytest

from auvbench.commands.progress import bar_line
from auvbench.runs.progress import Progress


def at(**changes: float | None) -> Progress:
    values: dict[str, float | None] = {
        "steps": 1_412_345,
        "total_steps": 2_000_000,
        "steps_per_s": 29_776.0,
        "episodes": 500,
        "success_rate": 1.0,
        "mean_return": -12_345.0,
        "time": time.time(),
    }
    return Progress(**values | changes)  # type: ignore[arg-type]


@pytest.mark.parametrize("width", [60, 80, 100, 140, 240])
def test_steps_success_and_time_are_whole_at_any_width(width: int) -> None:
    line = bar_line(at(), 4000.0, width)
    assert len(line) <= max(width, 60)
    for whole in ("1,412,345 of 2,000,000 steps", "20 s left", "success 100 %"):
        assert whole in line
    if width >= 80:
        assert "━" in line
    if width >= 140:
        assert "return -12,345" in line


def test_success_waits_for_episodes() -> None:
    assert "success" not in bar_line(at(episodes=29), 1.0, 140)
    assert "success 100 %" in bar_line(at(episodes=30), 1.0, 140)


def test_before_anything_is_known() -> None:
    line = bar_line(at(steps=0, steps_per_s=0.0, episodes=0, success_rate=None, mean_return=None), 3.0, 80)
    assert line.endswith("0 of 2,000,000 steps, 3 s")

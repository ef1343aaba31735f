"""The figures next to the bar of a training."""

from __future__ import annotations

import time

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


def test_success_waits_for_episodes() -> None:
    assert str(at(episodes=29)) == "20 s left, 29,776 steps/s, return -12,345"
    assert str(at(episodes=30)) == "20 s left, success 100 %, 29,776 steps/s, return -12,345"


def test_before_anything_is_known() -> None:
    assert (
        str(at(steps_per_s=0.0, episodes=0, success_rate=None, mean_return=None))
        == "estimating the time to go"
    )

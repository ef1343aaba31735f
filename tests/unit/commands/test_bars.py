"""The figures next to the bar of a training."""

from __future__ import annotations

import time

import pytest

from auvbench.commands import progress as bars
from auvbench.commands.progress import figures
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
    assert figures(at(episodes=29)) == "20 s left, 29,776 steps/s, return -12,345"
    assert figures(at(episodes=30)) == "20 s left, success 100 %, 29,776 steps/s, return -12,345"


def test_before_anything_is_known() -> None:
    assert (
        figures(at(steps_per_s=0.0, episodes=0, success_rate=None, mean_return=None))
        == "estimating the time to go"
    )


class Run:
    id = "mpc-1"


def test_the_time_of_compiling_is_no_part_of_the_estimate(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = iter([0.0, 60.0, 80.0])  # the first episode takes a minute, the next ten 20 s
    monkeypatch.setattr(bars.time, "monotonic", lambda: next(clock))
    teller = bars.Teller(total=1, parts=100)
    teller.doing(Run(), "nominal", 1)  # type: ignore[arg-type]
    teller.doing(Run(), "nominal", 10)  # type: ignore[arg-type]
    assert capsys.readouterr().err.splitlines() == [
        "mpc-1: nominal, 1 of 100 episodes, estimating the time to go",
        "mpc-1: nominal, 11 of 100 episodes, 2 min 58 s left",
    ]

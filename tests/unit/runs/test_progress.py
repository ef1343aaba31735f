"""The pace that a run reports."""

from __future__ import annotations

import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from auvbench.runs import progress


def test_the_pace_is_that_since_the_first_step(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Compilation until the first step takes 60 s; then 100 steps take 1 s.
    clock = iter([0.0, 60.0, 61.0])
    # The module's own name alone: threads that other tests left ask the clock, too.
    monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda: next(clock), time=time.time))
    told: list[progress.Progress] = []
    reporter = progress.Reporter(tmp_path / "progress.json", 1100, told.append)
    reporter.step(100)
    reporter.step(200)
    assert [at.steps_per_s for at in told] == [0.0, 100.0]
    assert [at.remaining for at in told] == [None, 9.0]

"""What is seen of a sweep, and the estimate of its end."""

from __future__ import annotations

import doctest
import io
import json
import time
from pathlib import Path

import pytest
from rich.console import Console

from auvbench.runs import progress
from auvbench.runs.directory import RunDirectory
from auvbench.runs.progress import Progress
from auvbench.scheduling import views
from auvbench.scheduling.loop import Outcome, Phase, Status
from tests import fake_training


class FakeJob:
    mark = None

    def __init__(self, run: Path) -> None:
        self.run = run

    def poll(self) -> Status:
        return Status(Phase.RUNNING)

    def cancel(self, *, force: bool = False) -> None: ...

    def __str__(self) -> str:
        return "pid 4711"


def write(run: RunDirectory, steps: int, per_s: float, episodes: int = 120) -> None:
    at = Progress(steps, 1000, per_s, episodes, 0.83, None, time.time())
    (run.path / "progress.json").write_text(json.dumps({f: getattr(at, f) for f in at.__slots__}))


@pytest.fixture
def runs(tmp_path: Path) -> list[RunDirectory]:
    return [fake_training.make(tmp_path / f"run{number}", total_steps=1000) for number in range(4)]


def start(view: views.View, run: RunDirectory) -> None:
    view.started(run, FakeJob(run.path))
    view.polled(run, Phase.RUNNING)


def test_the_examples_in_the_documentation() -> None:
    assert doctest.testmod(progress).failed == 0


def test_the_sweep_ends_when_all_steps_are_done(
    runs: list[RunDirectory], monkeypatch: pytest.MonkeyPatch
) -> None:
    view = views.View(Console(file=io.StringIO()), runs)
    assert view.remaining() is None  # before a run has shown a step
    assert "estimating" in view.counts()
    for run in runs[:2]:
        start(view, run)
        write(run, 500, 100.0)
    view.refresh()
    monkeypatch.setattr(views.time, "monotonic", lambda: view._begun + 10.0)
    assert view.remaining() == pytest.approx(30.0), "1,000 steps in 10 s, and 3,000 to go"
    assert "30 s to go" in view.counts()


def test_a_controller_that_does_not_learn_takes_no_time_worth_mentioning(
    runs: list[RunDirectory], monkeypatch: pytest.MonkeyPatch
) -> None:
    for run in runs[1:]:
        run.config_path.write_text("algo: {name: mine, agent: pid}")
    view = views.View(Console(file=io.StringIO()), runs)
    start(view, runs[0])
    write(runs[0], 500, 100.0)
    view.refresh()
    monkeypatch.setattr(views.time, "monotonic", lambda: view._begun + 5.0)
    assert view.remaining() == pytest.approx(5.0)


def test_plain_lines_say_what_happens(runs: list[RunDirectory], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(views, "LINES_EVERY", 0.0)
    text = io.StringIO()
    view = views.View(Console(file=text, width=200), runs)
    start(view, runs[0])
    write(runs[0], 500, 100.0)
    view.refresh()
    view.ended(runs[0], Outcome.FAILED, "the loss is not a number")
    lines = text.getvalue().splitlines()
    assert lines[0].endswith("run0: running as pid 4711")
    assert any(
        line.endswith("run0: 500 of 1,000 steps, 5 s left, success 83 %, 100 steps/s") for line in lines
    )
    assert any("0 of 4 complete, 1 running, 3 waiting" in line for line in lines)
    assert lines[-1].endswith("run0: failed (the loss is not a number)")
    assert not any("\x1b" in line for line in lines)


LONG = "ppo_thesis-bluerov2_realistic_inertia-k100-f55-s4-4ef700ae"


def test_in_a_notebook_the_runs_are_lines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its cells give a command a terminal, which cannot move the cursor."""
    monkeypatch.setenv("JPY_PARENT_PID", "17")
    run = fake_training.make(tmp_path / "run", total_steps=1000)
    view = views.View(Console(file=(text := io.StringIO()), force_terminal=True), [run])
    view.begin()
    view.ended(run, Outcome.COMPLETE, "")
    view.end()
    assert "run: complete" in text.getvalue()
    assert "\x1b[" not in text.getvalue()


@pytest.mark.parametrize("width", [80, 140])
@pytest.mark.parametrize("name", ["sac-k100-f25-s2-1b2a83c4", LONG])
def test_a_terminal_shows_a_bar_for_each_run_at_work(tmp_path: Path, width: int, name: str) -> None:
    run = fake_training.make(tmp_path / name, total_steps=1000)
    other = fake_training.make(tmp_path / "other", total_steps=1000)
    text = io.StringIO()
    view = views.View(Console(file=text, width=width, force_terminal=True), [run, other])
    view.begin()
    start(view, run)
    write(run, 412, 100.0, episodes=3)
    view.refresh()
    plain = Console(file=(shown := io.StringIO()), width=width)
    plain.print(view.shown())
    lines = shown.getvalue().splitlines()
    assert max(map(len, lines)) <= width
    assert lines[0].startswith("0 of 2 complete, 1 running, 1 waiting")
    assert "412/1000" in lines[1]
    assert "success" not in shown.getvalue(), "of 3 episodes it says nothing"
    view.ended(run, Outcome.FAILED, "the loss is not a number")
    assert "failed (the loss" in text.getvalue().replace("\n", "")
    assert not view.bars.tasks
    view.end()

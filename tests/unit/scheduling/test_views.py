"""What is seen of a sweep, and the estimate of its end."""

from __future__ import annotations

import doctest
import io
import json
import time
from dataclasses import asdict
from pathlib import Path

import pytest
import yaml
from omegaconf import OmegaConf
from rich.console import Console

from auvbench.runs import progress
from auvbench.runs.directory import RunDirectory
from auvbench.runs.progress import Progress
from auvbench.scheduling import views
from auvbench.scheduling.loop import Outcome, Phase, Status
from tests import configs, fake_training


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


def test_the_sweep_ends_when_its_last_run_does(runs: list[RunDirectory]) -> None:
    view = views.View(Console(file=io.StringIO()), runs, 2)
    assert view.remaining() is None  # nobody knows before a run has shown its pace
    for run in runs[:2]:
        start(view, run)
        write(run, 500, 100.0)
    view.refresh()
    # Two have 5 s to go; the other two then take 10 s each at the pace of the first.
    assert view.remaining() == pytest.approx(15.0)


def test_a_controller_that_does_not_learn_takes_no_time_worth_mentioning(runs: list[RunDirectory]) -> None:
    for run in runs[1:]:
        run.config_path.write_text("algo: {name: mine, agent: pid}")
    view = views.View(Console(file=io.StringIO()), runs, 1)
    start(view, runs[0])
    write(runs[0], 500, 100.0)
    view.refresh()
    assert view.remaining() == pytest.approx(5.0)


def test_plain_lines_say_what_happens(runs: list[RunDirectory], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(views, "LINES_EVERY", 0.0)
    text = io.StringIO()
    view = views.View(Console(file=text, width=200), runs, 2)
    start(view, runs[0])
    write(runs[0], 500, 100.0)
    view.refresh()
    view.ended(runs[0], Outcome.FAILED, "the loss is not a number")
    lines = text.getvalue().splitlines()
    assert lines[0].endswith("run0: running as pid 4711")
    assert any(
        line.endswith("run0: 500 of 1,000 steps, 5 s left, success 83 %, 100 steps/s") for line in lines
    )
    assert any("0 of 4 complete, 1 running" in line and "to go, until" in line for line in lines)
    assert lines[-1].endswith("run0: failed (the loss is not a number)")
    assert not any("\x1b" in line for line in lines)


def test_the_table_shows_each_run_and_fits(runs: list[RunDirectory]) -> None:
    text = io.StringIO()
    console = Console(file=text, width=100, height=8, force_terminal=True)
    view = views.View(console, runs, 2)
    start(view, runs[2])
    write(runs[2], 250, 100.0)
    view.refresh()
    lines = shown(view, 100)
    words = lines[1].split()
    assert (words[:2], words[-5:]) == (["run2", "running"], ["250", "100", "83%", "8", "s"])
    assert lines[2].strip() == "3 waiting: 3 ppo"
    assert lines[3].startswith("0 of 4 complete, 1 running")
    assert len(lines) < 8


def test_a_success_rate_of_a_few_episodes_is_not_shown(runs: list[RunDirectory]) -> None:
    view = views.View(Console(file=io.StringIO(), width=100), runs, 2)
    start(view, runs[0])
    write(runs[0], 250, 100.0, episodes=3)
    view.refresh()
    assert view.rows[runs[0].path].progress is not None
    assert "83%" not in shown(view, 100)[1]
    assert "success" not in str(view.rows[runs[0].path].progress)


LONG = "ppo_thesis-bluerov2_realistic_inertia-k100-f55-s4-4ef700ae"


def shown(view: views.View, width: int) -> list[str]:
    console = Console(file=(text := io.StringIO()), width=width)
    console.print(view.table())
    return text.getvalue().splitlines()


@pytest.mark.parametrize("width", [80, 100, 140, 200])
@pytest.mark.parametrize("name", ["sac-k100-f25-s2-1b2a83c4", LONG])
def test_steps_success_and_time_are_whole_at_any_width(tmp_path: Path, width: int, name: str) -> None:
    run = fake_training.make(tmp_path / name, total_steps=1_000_000)
    view = views.View(Console(file=io.StringIO(), width=width), [run], 1)
    row = view.rows[run.path]
    row.state = Phase.RUNNING
    row.progress = Progress(412_345, 1_000_000, 27.98, 500, 1.0, None, time.time())
    lines = shown(view, width)
    assert max(map(len, lines)) <= width
    for whole in ("running", "412,345", "100%", "5 h 50 min"):
        assert whole in lines[1], whole


def configured(path: Path, algo: str, total_steps: int, **changes: object) -> RunDirectory:
    run = fake_training.make(path, algo=algo, total_steps=total_steps)
    config = configs.composed(f"algo={algo}")
    plain = OmegaConf.to_container(config.algo)
    assert isinstance(plain, dict)
    run.config_path.write_text(yaml.safe_dump({"algo": plain | changes}))
    return run


def test_the_time_to_go_waits_for_a_rate_of_every_algorithm(tmp_path: Path) -> None:
    runs = [configured(tmp_path / f"run{n}", algo, 1000) for n, algo in enumerate(["ppo", "ppo", "td3"])]
    view = views.View(Console(file=io.StringIO()), runs, 1)
    start(view, runs[0])
    write(runs[0], 500, 100.0)
    view.refresh()
    assert view.remaining() is None, "no rate of TD3 yet"
    assert "estimating" in view.counts()
    view.ended(runs[0], Outcome.COMPLETE, "")
    start(view, runs[2])
    (runs[2].path / "progress.json").write_text(
        json.dumps(asdict(Progress(500, 1000, 10.0, 5, None, None, time.time())))
    )
    view._next_read = 0.0
    view.refresh()
    assert view.remaining() == pytest.approx(50.0 + 10.0)
    assert "1 min to go" in view.counts()

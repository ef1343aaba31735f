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

from auvbench.runs.directory import RunDirectory
from auvbench.runs.progress import Progress
from auvbench.scheduling import estimate, views
from auvbench.scheduling.base import Phase, Status
from auvbench.scheduling.loop import Outcome
from auvbench.scheduling.rows import Row
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


def start(view: views.Watch, run: RunDirectory) -> None:
    view.started(run, FakeJob(run.path))
    view.polled(run, Phase.RUNNING)


@pytest.mark.parametrize("module", [estimate, views])
def test_the_examples_in_the_documentation(module: object) -> None:
    assert doctest.testmod(module).failed == 0  # type: ignore[arg-type]


def test_the_estimate_fills_free_slots_in_order() -> None:
    assert estimate.makespan([3.0], [10.0, 1.0, 1.0], 2) == 10.0
    assert estimate.makespan([], [], 2) == 0.0
    assert estimate.makespan([], [4.0] * 5, 2) == 12.0


def test_the_sweep_ends_when_its_last_run_does(runs: list[RunDirectory]) -> None:
    view = views.PlainView(runs, 2, Console(file=io.StringIO()))
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
    view = views.PlainView(runs, 1, Console(file=io.StringIO()))
    start(view, runs[0])
    write(runs[0], 500, 100.0)
    view.refresh()
    assert view.remaining() == pytest.approx(5.0)


def test_plain_lines_say_what_happens(runs: list[RunDirectory], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(views, "LINES_EVERY", 0.0)
    text = io.StringIO()
    view = views.view(runs, 2, Console(file=text, width=200))
    assert isinstance(view, views.PlainView)
    start(view, runs[0])
    write(runs[0], 500, 100.0)
    view.refresh()
    view.ended(runs[0], Outcome.FAILED, "the loss is not a number")
    lines = text.getvalue().splitlines()
    assert lines[0].endswith("run0: running as pid 4711")
    assert any(line.endswith("run0: 50%, 100 steps/s, success 83%, 5 s to go") for line in lines)
    assert any("0 of 4 complete, 1 running" in line and "to go, until" in line for line in lines)
    assert lines[-1].endswith("run0: failed (the loss is not a number)")
    assert not any("\x1b" in line for line in lines)


def test_the_table_shows_each_run_and_fits(runs: list[RunDirectory]) -> None:
    text = io.StringIO()
    console = Console(file=text, width=100, height=8, force_terminal=True)
    view = views.view(runs, 2, console)
    assert isinstance(view, views.TableView)
    start(view, runs[2])
    write(runs[2], 250, 100.0)
    view.refresh()
    plain = Console(file=(shown := io.StringIO()), width=100)
    plain.print(view.table())
    lines = shown.getvalue().splitlines()
    assert lines[1].split() == ["run2", "running", "━" * 5 + "╌" * 15, "250", "100", "83%", "8", "s"]
    assert lines[2].strip() == "3 waiting: 3 ppo"
    assert lines[3].startswith("0 of 4 complete, 1 running")
    assert len(lines) < 8


def test_a_success_rate_of_a_few_episodes_is_not_shown(runs: list[RunDirectory]) -> None:
    view = views.TableView(runs, 2, Console(file=io.StringIO(), width=100))
    start(view, runs[0])
    write(runs[0], 250, 100.0, episodes=3)
    view.refresh()
    assert view.rows[runs[0].path].progress is not None
    (_, line) = views.lines([view.rows[runs[0].path]], {"run0": 8.0}, 100)
    assert "%" not in line.plain
    assert "success" not in views.sentence(view.rows[runs[0].path].progress)  # type: ignore[arg-type]


LONG = "ppo_thesis-bluerov2_realistic_inertia-k100-f55-s4-4ef700ae"


@pytest.mark.parametrize("width", [80, 100, 140, 200])
@pytest.mark.parametrize("name", ["sac-k100-f25-s2-1b2a83c4", LONG])
def test_steps_success_and_time_are_whole_at_any_width(tmp_path: Path, width: int, name: str) -> None:
    run = fake_training.make(tmp_path / name, total_steps=1_000_000)
    row = Row.of(run)
    row.state = Phase.RUNNING
    row.progress = Progress(412_345, 1_000_000, 1308.4, 500, 1.0, None, time.time())
    heading, line = (text.plain for text in views.lines([row], {name: 5 * 3600 + 50 * 60}, width))
    assert max(len(heading), len(line)) <= width
    for whole in ("running", "412,345", "100%", "5 h 50 min", name[-8:], name[:10]):
        assert whole in line, whole
    assert ("steps/s" in heading) == ("1,308" in line)
    if width >= 140:
        assert "━" in line
        assert "1,308" in line


def configured(path: Path, algo: str, total_steps: int, **changes: object) -> RunDirectory:
    run = fake_training.make(path, algo=algo, total_steps=total_steps)
    config = configs.composed(f"algo={algo}")
    plain = OmegaConf.to_container(config.algo)
    assert isinstance(plain, dict)
    run.config_path.write_text(yaml.safe_dump({"algo": plain | changes}))
    return run


def test_the_time_to_go_waits_for_a_rate_of_every_algorithm(tmp_path: Path) -> None:
    runs = [configured(tmp_path / f"run{n}", algo, 1000) for n, algo in enumerate(["ppo", "ppo", "td3"])]
    view = views.PlainView(runs, 1, Console(file=io.StringIO()))
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
    assert view.remaining() is None, "TD3 makes no update in its first steps"
    view.rows[runs[2].path].warm_up = 0
    assert view.remaining() == pytest.approx(50.0 + 10.0)
    assert "1 min to go" in view.counts()


def test_a_learner_is_not_believed_before_it_learns(tmp_path: Path) -> None:
    run = configured(tmp_path / "run", "sac", 1_000_000)
    row = Row.of(run)
    row.progress = Progress(1500, 1_000_000, 25_000.0, 10, None, None, time.time())
    assert row.pace is None
    row.progress = Progress(100_000, 1_000_000, 900.0, 10, None, None, time.time())
    assert row.pace == 900.0

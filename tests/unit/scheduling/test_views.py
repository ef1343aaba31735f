"""What is seen of a sweep, and the estimate of its end."""

from __future__ import annotations

import doctest
import io
import json
import time
from pathlib import Path

import pytest
import yaml
from omegaconf import OmegaConf
from rich.console import Console

from auvbench.config.compose import compose
from auvbench.runs.directory import RunDirectory
from auvbench.runs.progress import Progress
from auvbench.scheduling import estimate, live_table, paces, views
from auvbench.scheduling.base import Phase, Status
from auvbench.scheduling.loop import Outcome
from auvbench.scheduling.rows import Row
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


def start(view: views.Watch, run: RunDirectory) -> None:
    view.started(run, FakeJob(run.path))
    view.polled(run, Phase.RUNNING)


@pytest.mark.parametrize("module", [estimate, paces, views])
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
    (_, line) = live_table.lines([view.rows[runs[0].path]], {"run0": 8.0}, 100)
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
    heading, line = (text.plain for text in live_table.lines([row], {name: 5 * 3600 + 50 * 60}, width))
    assert max(len(heading), len(line)) <= width
    for whole in ("running", "412,345", "100%", "5 h 50 min", name[-8:], name[:10]):
        assert whole in line, whole
    assert ("steps/s" in heading) == ("1,308" in line)
    if width >= 140:
        assert "━" in line
        assert "1,308" in line


def configured(path: Path, algo: str, total_steps: int, **changes: object) -> RunDirectory:
    run = fake_training.make(path, algo=algo, total_steps=total_steps)
    config = compose("train", [f"algo={algo}"])
    plain = OmegaConf.to_container(config.algo)
    assert isinstance(plain, dict)
    run.config_path.write_text(yaml.safe_dump({"algo": plain | changes}))
    return run


def test_the_estimate_knows_that_sac_is_slower_before_one_has_run(tmp_path: Path) -> None:
    runs = [
        configured(tmp_path / f"run{n}", algo, 1_000_000)
        for n, algo in enumerate(["ppo", "ppo", "sac", "sac"])
    ]
    view = views.PlainView(runs, 2, Console(file=io.StringIO()))
    before = view.remaining()
    assert before is not None
    ppo, sac = (1e6 / (paces.prior(run.config()["algo"]) or 0.0) for run in (runs[0], runs[2]))
    assert sac > 5 * ppo
    assert before == pytest.approx(ppo + sac)
    for run in runs[:2]:
        start(view, run)
        at = Progress(
            500_000, 1_000_000, 0.5e6 / ppo, 500, 0.9, None, time.time()
        )  # half as fast as measured
        (run.path / "progress.json").write_text(json.dumps({f: getattr(at, f) for f in at.__slots__}))
    view.refresh()
    assert view.remaining() == pytest.approx(ppo + 2 * sac), "this machine is half as fast in all"


def test_a_learner_is_not_believed_before_it_learns(tmp_path: Path) -> None:
    run = configured(tmp_path / "run", "sac", 1_000_000)
    row = Row.of(run)
    row.progress = Progress(1500, 1_000_000, 25_000.0, 10, None, None, time.time())
    assert row.pace is None
    row.progress = Progress(100_000, 1_000_000, 900.0, 10, None, None, time.time())
    assert row.pace == 900.0


def test_what_the_configuration_changes_changes_the_estimate(tmp_path: Path) -> None:
    usual = configured(tmp_path / "a", "sac", 1000).config()["algo"]
    assert paces.prior(usual | {"gradient_steps": 32}) < 0.5 * (paces.prior(usual) or 0.0)  # type: ignore[operator]
    assert paces.prior({"name": "mine", "agent": "mine"}) is None
    assert paces.prior({**usual, "name": "mine"}) == paces.prior(usual)
    assert paces.prior({**usual, "n_envs": "many"}) is None


def test_a_grid_of_more_than_an_hour_says_so(tmp_path: Path) -> None:
    long = [configured(tmp_path / f"run{n}", "sac", 1_000_000) for n in range(60)]
    said = views.PlainView(long, 2, Console(file=io.StringIO())).forecast()
    assert said.startswith("this takes some ")
    assert " h" in said
    assert "60 runs that learn, 2 at a time" in said
    assert "another machine" in said
    short = [configured(tmp_path / f"short{n}", "ppo", 1000) for n in range(4)]
    assert views.PlainView(short, 2, Console(file=io.StringIO())).forecast() == ""
    unknown = [configured(tmp_path / "mine", "sac", 10**9, name="mine", agent="mine")]
    assert views.PlainView(unknown, 2, Console(file=io.StringIO())).forecast() == ""

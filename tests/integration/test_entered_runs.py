"""Agents of installed packages: trained, tested and ranked like everyone else, and named when they fail."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from auvbench import cli
from auvbench.runs.directory import RunDirectory, find_runs
from auvbench.training.execute import execute
from auvbench.training.learning import Session
from tests.packages import Site, learning, site, steering

__all__ = ["site"]

BRIEF = ("protocol.episodes=2", "--workers", "1")
SHORT = ("train.total_steps=400", "train.progress=false", "train.checkpoint.steps=100")


def runs(folder: str = "outputs") -> dict[str, RunDirectory]:
    return {run.id.partition("-")[0]: run for run in find_runs([folder])}


@pytest.mark.slow
def test_they_stand_in_the_table_beside_the_others(site: Site) -> None:
    steering(site)
    learning(site)
    for algo in ("pid", "mine", "slow"):
        assert cli.main(["train", f"algo={algo}", *SHORT]) == 0
    assert cli.main(["evaluate", "outputs", *BRIEF]) == 0
    assert cli.main(["report", "outputs", "--no-figures"]) == 0
    with Path("outputs/default/report/table.csv").open() as file:
        agents = {row["agent"].lower() for row in csv.DictReader(file)}
    assert agents >= {"pid", "mine", "slow"}
    manifest = runs()["slow"].manifest()
    assert manifest["versions"]["slow-package"] == "1.0"
    assert manifest["steps"] >= 400
    assert set(manifest["files"]) == {"model/sum.json", "train/episodes.csv"}
    summary = json.loads((runs()["mine"].evaluation("test") / "summary.json").read_text())
    assert summary["versions"]["mine-package"] == "1.0"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("act", "found"),
    [
        ("return np.zeros((len(observation), 2))", "(1, 2)"),
        ("return np.full((len(observation), self.n_u), np.nan)", "nan"),
        ("return np.full((len(observation), self.n_u), 1.5)", "1.5"),
        ("return [[0.0] * self.n_u]", "a list"),
        ("return np.full((len(observation), self.n_u), 'x')", "<U1"),
        ("return observation.nothing", "AttributeError"),
    ],
)
def test_one_that_gives_no_actions_is_a_failed_run_and_the_others_go_on(
    site: Site, capsys: pytest.CaptureFixture[str], act: str, found: str
) -> None:
    steering(site, act)
    assert cli.main(["train", "algo=mine"]) == 1
    _, package, what = capsys.readouterr().err.partition("mine of mine-package==1.0: ")
    assert package
    assert found in what
    manifest = runs()["mine"].manifest()
    assert manifest["state"] == "failed"
    assert manifest["error"]["type"] == "AgentError"
    assert "mine of mine-package==1.0" in manifest["error"]["message"]


@pytest.mark.slow
def test_a_grid_names_the_log_with_the_traceback(site: Site, capsys: pytest.CaptureFixture[str]) -> None:
    steering(site, "return observation.nothing")
    assert cli.main(["train", "-m", "algo=mine", "launcher.workers=1"]) == 1
    log = runs()["mine"].train / "log.txt"
    assert f"its traceback is in {log}" in capsys.readouterr().out
    assert "return observation.nothing" in log.read_text()


@pytest.mark.slow
def test_a_grid_goes_on_without_it(site: Site, capsys: pytest.CaptureFixture[str]) -> None:
    steering(site, "return np.full((len(observation), self.n_u), np.nan)")
    assert cli.main(["train", "-m", "algo=mine,pid,random", "launcher.workers=1"]) == 1
    states = {name: run.manifest()["state"] for name, run in runs().items()}
    assert states == {"mine": "failed", "pid": "complete", "random": "complete"}


@pytest.mark.slow
def test_one_that_fails_in_a_test_is_a_line_and_the_others_are_tested(
    site: Site, capsys: pytest.CaptureFixture[str]
) -> None:
    steering(site, "return np.full((len(observation), self.n_u), 2.0 if len(observation) > 1 else 0.0)")
    for algo in ("mine", "random"):
        assert cli.main(["train", f"algo={algo}"]) == 0
    capsys.readouterr()
    assert cli.main(["evaluate", "outputs", *BRIEF]) == 1
    said = capsys.readouterr()
    lines = [line for line in said.err.splitlines() if "mine-package==1.0" in line]
    assert len(lines) == 1
    assert "the action 2" in lines[0]
    assert said.out.count(": success ") == 1
    assert "Traceback" not in said.err


@pytest.mark.slow
@pytest.mark.parametrize(
    ("action", "message"),
    [
        ("action = np.full((environment.n, self.n_u), np.nan)", "must be finite numbers"),
        ("action = np.zeros((environment.n, 2))", r"an action of shape (4, 2): must be (4, 6)"),
        ("return", "the learner returned at step 0 of 400"),
        ("raise ValueError('its own')", "ValueError: its own"),
    ],
)
def test_a_learner_that_fails_is_a_failed_run(
    site: Site, capsys: pytest.CaptureFixture[str], action: str, message: str
) -> None:
    learning(site, action=action)
    assert cli.main(["train", "algo=slow", *SHORT]) == 1
    assert message in capsys.readouterr().err
    manifest = runs()["slow"].manifest()
    assert manifest["state"] == "failed"
    assert message.removeprefix("ValueError: ") in manifest["error"]["message"]


def struck_and_resumed(monkeypatch: pytest.MonkeyPatch) -> RunDirectory:
    """`algo=slow`, struck down once at step 250 and then brought to its end."""
    ordinary, armed = Session.step, [True]

    def strike(self: Session, steps: int, transition: object) -> float:
        if armed and steps >= 250:
            armed.clear()
            raise KeyboardInterrupt
        return ordinary(self, steps, transition)  # type: ignore[arg-type]

    monkeypatch.setattr(Session, "step", strike)
    assert cli.main(["train", "algo=slow", *SHORT, "output=struck"]) == 130
    monkeypatch.setattr(Session, "step", ordinary)
    run = runs("struck")["slow"]
    assert run.manifest()["state"] == "interrupted"
    execute(run)
    return run


@pytest.mark.slow
def test_a_learner_that_resumes_exactly_ends_with_the_same_bits(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    learning(site)
    assert cli.main(["train", "algo=slow", *SHORT]) == 0
    run, whole = struck_and_resumed(monkeypatch), runs()["slow"]
    for name in ("model/sum.json", "train/episodes.csv"):
        assert (run.path / name).read_bytes() == (whole.path / name).read_bytes()
    assert run.manifest()["attempts"] == 2
    assert "started_over" not in run.manifest()


@pytest.mark.slow
def test_one_that_cannot_begins_anew_and_its_manifest_says_so(
    site: Site, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    learning(site, exact=False)
    assert cli.main(["train", "algo=slow", *SHORT]) == 0
    run, whole = struck_and_resumed(monkeypatch), runs()["slow"]
    for name in ("model/sum.json", "train/episodes.csv"):
        assert (run.path / name).read_bytes() == (whole.path / name).read_bytes()
    assert run.manifest()["started_over"] == [248]
    assert not list(run.checkpoints.glob("[0-9]*"))
    capsys.readouterr()
    assert cli.main(["resume", str(run.path), "train.total_steps=800"]) == 2
    assert "cannot be extended: slow does not resume exactly" in capsys.readouterr().err


@pytest.mark.slow
def test_an_exact_one_is_extended(site: Site) -> None:
    learning(site)
    assert cli.main(["train", "algo=slow", *SHORT]) == 0
    assert cli.main(["resume", str(runs()["slow"].path), "train.total_steps=800"]) == 0
    assert cli.main(["train", "algo=slow", *SHORT, "train.total_steps=800", "output=whole"]) == 0
    extended = next(run for run in find_runs(["outputs"]) if run.manifest()["total_steps"] == 800)
    whole = runs("whole")["slow"]
    assert extended.id == whole.id
    assert (extended.model / "sum.json").read_bytes() == (whole.model / "sum.json").read_bytes()


@pytest.mark.slow
def test_without_its_package_a_run_is_listed_and_reported_and_evaluate_says_what_to_install(
    site: Site, capsys: pytest.CaptureFixture[str]
) -> None:
    steering(site)
    learning(site)
    for algo in ("mine", "slow", "random"):
        assert cli.main(["train", f"algo={algo}", *SHORT]) == 0
    assert cli.main(["evaluate", "outputs", *BRIEF]) == 0
    ids = {name: run.id for name, run in runs().items()}
    site.uninstall("mine-package")
    site.uninstall("slow-package")
    capsys.readouterr()
    assert cli.main(["runs", "outputs"]) == 0
    assert "mine" in capsys.readouterr().out
    assert cli.main(["report", "outputs", "--no-figures"]) == 0
    with Path("outputs/default/report/table.csv").open() as file:
        found = {row["agent"].lower(): row for row in csv.DictReader(file)}
    assert set(found) >= {"mine", "slow", "random"}
    assert {name: run.id for name, run in runs().items()} == ids
    capsys.readouterr()
    assert cli.main(["evaluate", "outputs", *BRIEF, "--force"]) == 1
    said = capsys.readouterr()
    for name in ("mine", "slow"):
        lines = [line for line in said.err.splitlines() if f"{name}-package" in line]
        assert len(lines) == 1
        assert f"pip install '{name}-package==1.0'" in lines[0]
    assert said.out.count(": success ") == 1
    assert "Traceback" not in said.err
    assert cli.main(["resume", "outputs"]) == 0  # nothing is unfinished

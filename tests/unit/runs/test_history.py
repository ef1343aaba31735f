"""The history of an experiment: appended by many processes, never trusted, and no harm to a run."""

from __future__ import annotations

import json
import os
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from auvbench.cli import main
from auvbench.config.compose import compose
from auvbench.config.validate import evaluate_config
from auvbench.errors import AuvbenchWarning
from auvbench.evaluation.evaluate import evaluate
from auvbench.reporting.archive import write_history
from auvbench.runs import history
from auvbench.runs.directory import RunDirectory
from auvbench.runs.history import Line
from auvbench.runs.plan import prepare
from auvbench.training.execute import execute
from tests.synthetic import write_experiment

TIME = "2026-11-28T06:00:00+00:00"


def line(number: int, event: str = "tested", run: str = "pid") -> Line:
    return Line(TIME, event, run, seed=number)  # type: ignore[arg-type]


def test_trainings_and_tests_are_lines(tmp_path: Path) -> None:
    run = prepare(compose("train", [f"output={tmp_path}", "algo=pid", "name=a"]))
    execute(run)
    protocol = evaluate_config(compose("evaluate", ["protocol.episodes=2"])).protocol
    summary = evaluate(run, protocol)
    assert summary is not None
    found = history.read(tmp_path / "a")
    assert [one.event for one in found] == ["running", "complete", "tested"]
    assert {(one.run, one.algo, one.seed) for one in found} == {(run.id, "pid", 42)}
    test = found[-1]
    assert (test.protocol, test.fingerprint, test.episodes) == ("test", summary["fingerprint"], 2)


def test_a_declaration_is_a_line(tmp_path: Path) -> None:
    run = prepare(compose("train", ["experiment=quickstart", f"output={tmp_path}", "algo=pid"]))
    (found,) = history.read(run.path.parent)
    assert (found.event, found.analysis) == ("declared", run.manifest()["analysis"])


def test_lines_of_many_writers_are_whole(tmp_path: Path) -> None:
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda number: history.append(tmp_path, line(number)), range(100)))
    assert sorted(one.seed or 0 for one in history.read(tmp_path)) == list(range(100))


def test_a_line_that_was_cut_short_costs_no_other(tmp_path: Path) -> None:
    history.append(tmp_path, line(0))
    with (tmp_path / history.FILE).open("ab") as file:
        file.write(b'{"time": "2026')
    history.append(tmp_path, line(1))
    assert [one.seed for one in history.read(tmp_path)] == [0, 1]


@pytest.mark.parametrize(
    "text",
    [
        "not JSON",
        "[" * 100_000,
        '{"time": "x"}',
        '{"time": "x", "event": "won"}',
        '{"time": "x", "event": "tested", "run": 5}',
        '{"time": "\\u001b[31m", "event": "tested"}',
    ],
)
def test_damaged_lines_are_left_out(tmp_path: Path, text: str) -> None:
    (tmp_path / history.FILE).write_text(f"{text}\n{line(3).text}\n")
    assert history.read(tmp_path) == [line(3)]


def test_a_history_without_end_is_refused(tmp_path: Path) -> None:
    with (tmp_path / history.FILE).open("wb") as file:
        file.truncate(1 << 30)
    with pytest.raises(ValueError, match="more than 16 MiB"):
        history.read(tmp_path)


@pytest.mark.parametrize("kind", ["link", "hard link", "folder", "pipe", "full"])
def test_what_cannot_be_written_warns_and_harms_nothing(
    tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    target, path = tmp_path / "bashrc", tmp_path / history.FILE
    target.write_text("kept")
    if kind == "link":
        path.symlink_to(target)
    elif kind == "hard link":
        path.hardlink_to(target)
    elif kind == "folder":
        path.mkdir()
    elif kind == "pipe":
        os.mkfifo(path)
    else:

        def full(*_: object) -> int:
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(os, "write", full)
    with pytest.warns(AuvbenchWarning, match="cannot write the history"):
        history.append(tmp_path, line(0))
    assert target.read_text() == "kept"


def test_the_history_keeps_runs_that_are_deleted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (run, *_) = write_experiment(
        tmp_path / "outputs/grid", algorithms=("ppo",), seeds=(0, 1), episodes=5, train_episodes=5
    )
    for one in ("gone", run.name):
        history.append(run.parent, line(0, "running", one))
        history.append(run.parent, line(0, "tested", one))
    assert main(["runs"]) == 0
    assert (
        "history: 2 trainings and 2 tests; 1 training and 1 test are of 1 run that is not here (auvbench runs --history)"
        in capsys.readouterr().out
    )
    assert main(["runs", "outputs/grid", "--history"]) == 0
    printed = [json.loads(text) for text in capsys.readouterr().out.splitlines()]
    assert [one["run"] for one in printed] == ["gone", "gone", run.name, run.name]


def test_without_a_history_the_command_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "outputs").mkdir()
    assert main(["runs", "--history"]) == 2
    assert "no history.jsonl found" in capsys.readouterr().err
    assert main(["runs", "--history", "--json"]) == 2
    assert "leave out --where and --json" in capsys.readouterr().err


def test_a_study_publishes_the_histories_of_its_experiments(tmp_path: Path) -> None:
    from auvbench.analysis.load import load

    runs = write_experiment(tmp_path / "a", algorithms=("pid",), episodes=5, train_episodes=0)
    runs += write_experiment(tmp_path / "b", algorithms=("random",), episodes=5, train_episodes=0)
    history.append(tmp_path / "a", line(0))
    history.append(tmp_path / "b", line(1))
    study = tmp_path / "study"
    study.mkdir()
    records, _ = load(runs)
    assert write_history(records, study) == []
    history.append(tmp_path / "b", line(2))
    assert write_history(records, study) == []  # lines that are there stay, and are there once
    assert [one.seed for one in history.read(study)] == [0, 1, 2]


def test_a_run_without_a_writable_folder_is_trained(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = prepare(compose("train", [f"output={tmp_path}", "algo=pid", "name=a"]))
    (tmp_path / "a" / history.FILE).mkdir()
    with warnings.catch_warnings(record=True):
        warnings.simplefilter("always")
        assert execute(RunDirectory(run.path))["state"] == "complete"

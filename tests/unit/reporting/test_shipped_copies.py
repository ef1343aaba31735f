"""Copies of runs in a study's folder: only our own are replaced or removed, and none is lost half way."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import pandas as pd
import pytest

from auvbench.analysis import consistency
from auvbench.analysis.load import load
from auvbench.errors import ReportError, RunError
from auvbench.reporting import copies, shipped
from auvbench.runs import integrity
from tests.synthetic import seal, write_evaluation, write_experiment


@pytest.fixture
def run(tmp_path: Path) -> Path:
    (run,) = write_experiment(
        tmp_path / "outputs" / "grid", algorithms=("ppo",), seeds=(0,), episodes=10, train_episodes=12
    )
    return run


def ship(run: Path, folder: Path, *protocols: str) -> list[str]:
    (record,), _ = load([run], protocols or ("test",))
    return shipped.ship(record, folder, "test")


def content(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_a_copy_says_so_under_its_seal(run: Path, tmp_path: Path) -> None:
    assert ship(run, tmp_path / "study") == []
    copy = tmp_path / "study/runs" / run.name
    assert copies.why_not_ours(copy) == ""
    assert "a run" in copies.why_not_ours(run)
    manifest = json.loads((copy / "manifest.json").read_text())
    assert manifest["shipped"] is True
    (copy / "manifest.json").write_text(json.dumps(manifest | {"steps": 1}))
    assert "seal" in copies.why_not_ours(copy)


def test_nothing_that_is_not_ours_is_replaced(run: Path, tmp_path: Path) -> None:
    study = tmp_path / "study"
    real = study / "runs" / run.name
    shutil.copytree(run, real)
    (real / "checkpoints").mkdir(exist_ok=True)
    (real / "checkpoints/weights.pt").write_bytes(b"weeks of work")
    before = content(real)
    with pytest.raises(ReportError, match="not a copy of one"):
        copies.prepare(study)
    with pytest.raises(RunError, match="left alone"):
        ship(run, study)
    with pytest.raises(RunError, match="left alone"):
        copies.remove(real)
    assert content(real) == before


@pytest.mark.parametrize("name", ["checkpoints/weights.pt", "model/policy.pt", "notes.txt", "train/log.txt"])
def test_a_copy_that_holds_something_else_is_left_alone(run: Path, tmp_path: Path, name: str) -> None:
    study = tmp_path / "study"
    ship(run, study)
    more = study / "runs" / run.name / name
    more.parent.mkdir(exist_ok=True)
    more.write_text("mine")
    for change in (
        lambda: copies.prepare(study),
        lambda: ship(run, study),
        lambda: copies.remove(more.parents[name.count("/")]),
    ):
        with pytest.raises((ReportError, RunError), match=name):
            change()
    assert more.read_text() == "mine"


@pytest.mark.parametrize("place", ["runs", "copy", "inside"])
def test_links_are_refused(run: Path, tmp_path: Path, place: str) -> None:
    study = tmp_path / "study"
    ship(run, study)
    copy = study / "runs" / run.name
    if place == "inside":
        (copy / "train").rename(tmp_path / "elsewhere")
        (copy / "train").symlink_to(tmp_path / "elsewhere")
    else:
        there = copy if place == "copy" else copy.parent
        there.rename(tmp_path / "elsewhere")
        there.symlink_to(tmp_path / "elsewhere")
    before = content(tmp_path / "elsewhere")
    with pytest.raises(ReportError, match=r"link|did not write"):
        copies.prepare(study)
    assert content(tmp_path / "elsewhere") == before


@pytest.mark.parametrize("at", range(3))
def test_a_replacement_that_is_interrupted_loses_nothing(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, at: int
) -> None:
    """At the first renaming, at the second, and while the earlier copy is removed."""
    study = tmp_path / "study"
    ship(run, study)
    copy = study / "runs" / run.name
    before = content(copy)
    write_evaluation(run, "test", ("nominal",), 11)  # what is shipped next differs

    def stop(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    rename, calls = Path.rename, []

    def renaming(path: Path, target: Path) -> Path:
        calls.append(path)
        return stop() if len(calls) == at + 1 else rename(path, target)  # type: ignore[func-returns-value]

    with monkeypatch.context() as patch:
        patch.setattr(Path, "rename", renaming)
        if at == 2:
            patch.setattr(copies.shutil, "rmtree", stop)
        with pytest.raises(KeyboardInterrupt):
            ship(run, study)
    copies.prepare(study)
    assert os.listdir(study / "runs") == [run.name]
    assert (content(copy) == before) == (at < 2)  # the earlier one, or the new one, whole
    (record,), problems = load([study])
    assert len(record.evaluations["test"].episodes) == (10 if at < 2 else 11)
    assert not problems
    ship(run, study)
    assert len(load([study])[0][0].evaluations["test"].episodes) == 11


def test_evaluations_that_are_not_asked_for_stay(run: Path, tmp_path: Path) -> None:
    study = tmp_path / "study"
    write_evaluation(run, "robustness", ("nominal", "current=0.5"), 10)
    ship(run, study, "test", "robustness")
    shutil.rmtree(run / "evaluations/robustness")
    ship(run, study)
    (record,), problems = load([study], ("test", "robustness"))
    assert sorted(record.evaluations) == ["robustness", "test"]
    assert not problems


def test_rows_that_were_changed_are_not_vouched_for_anew(run: Path, tmp_path: Path) -> None:
    rows = run / "train/episodes.csv"
    rows.write_bytes(rows.read_bytes().replace(b"timeout", b"success"))
    (said,) = ship(run, tmp_path / "study")
    assert "train/episodes.csv" in said
    assert not (tmp_path / "study/runs" / run.name / "train/episodes.csv.bz2").exists()
    assert load([tmp_path / "study"])[0][0].evaluations


def test_a_run_that_is_tested_again_meanwhile_is_not_shipped_half(run: Path, tmp_path: Path) -> None:
    (record,), _ = load([run])
    write_evaluation(run, "test", ("nominal",), 11)
    with pytest.raises(RunError, match="changed meanwhile"):
        shipped.ship(record, tmp_path / "study", "test")
    assert copies.names(tmp_path / "study") == []


def test_of_two_the_run_itself_counts_and_more_evaluations_count_more(run: Path, tmp_path: Path) -> None:
    study = tmp_path / "study"
    write_evaluation(run, "robustness", ("nominal",), 10)
    ship(run, study, "test", "robustness")
    both = ("test", "robustness")
    for paths in ([run, study], [study, run]):
        (record,), (problem,) = load(paths, both)
        assert record.directory == run
        assert "(a shipped copy) is not" in problem.message
    shutil.rmtree(run / "evaluations/robustness")
    (record,), (problem,) = load([run, study], both)
    assert record.directory == study / "runs" / run.name
    assert "(fewer evaluations) is not" in problem.message


def test_a_failed_training_is_shipped_without_its_traceback(run: Path, tmp_path: Path) -> None:
    manifest = json.loads((run / "manifest.json").read_text())
    error = {
        "type": "X",
        "message": f"NaN in {run.absolute()}/train",
        "step": 7,
        "traceback": "File /home/somebody",
    }
    manifest |= {"state": "failed", "error": error}
    (run / "manifest.json").write_text(json.dumps(integrity.sealed(manifest)))
    (record,), _ = load([run])
    shipped.ship(record, tmp_path / "study", "test")
    text = (tmp_path / "study/runs" / run.name / "manifest.json").read_text()
    assert "somebody" not in text
    assert str(tmp_path) not in text
    assert json.loads(text)["error"] == {"message": f"NaN in {run.name}/train", "step": 7}


def test_means_of_the_summary_are_those_of_the_shortened_rows(run: Path, tmp_path: Path) -> None:
    """Of few rows the mean may move by more than a report takes for rounding."""
    folder = write_evaluation(run, "test", ("nominal", "current"), 3)
    summary, rows = folder / "summary.json", pd.read_csv(folder / "episodes.csv")
    conditions = json.loads(summary.read_text())["conditions"]
    for condition in conditions:
        condition["mean_energy_J"] = float(rows["energy_J"][rows["condition"] == condition["name"]].mean())
    seal(summary, conditions=conditions)
    write_evaluation(run, "robustness", ("nominal", "current"), 3)
    (record,), _ = load([run], ("test", "robustness"))
    ship(run, tmp_path / "study", "test", "robustness")
    (copy,), problems = load([tmp_path / "study"], ("test", "robustness"))
    assert not problems
    assert copy.evaluations.keys() == {"test", "robustness"}
    said = copy.evaluations["test"].summary["conditions"][1]
    before = record.evaluations["test"].summary["conditions"][1]
    assert said["mean_energy_J"] == pytest.approx(before["mean_energy_J"], rel=1e-3)
    assert abs(said["mean_energy_J"] / before["mean_energy_J"] - 1.0) > consistency.TOLERANCE
    further = copy.evaluations["robustness"].summary["conditions"][1]
    assert not [name for name in further if name.startswith("mean_")]  # the rows say them
    assert (
        further["success_rate"] == record.evaluations["robustness"].summary["conditions"][1]["success_rate"]
    )

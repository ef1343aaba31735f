"""`auvbench publish` of several folders: a study grows, and no run is lost or changed."""

from __future__ import annotations

import shutil
from pathlib import Path

import pandas as pd
import pytest

from auvbench import cli
from auvbench.runs import declared
from tests.numbers import assert_same_numbers
from tests.synthetic import set_state, write_experiment

TO = "results/grid"


@pytest.fixture
def first(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return machine("first", ("pid", "ppo"), (0, 1))


def machine(name: str, algorithms: tuple[str, ...], seeds: tuple[int, ...]) -> list[Path]:
    return write_experiment(
        Path(name) / "outputs" / "grid", algorithms=algorithms, seeds=seeds, episodes=12, train_episodes=15
    )


def publish(*words: str, to: str = TO) -> int:
    return cli.main(["publish", *words, "--to", to, "--pictures", "success_over_time"])


def files(folder: str | Path) -> dict[str, bytes]:
    return {str(p): p.read_bytes() for p in Path(folder).rglob("*") if p.is_file()}


def published() -> list[str]:
    return sorted(pd.read_parquet(f"{TO}/runs.parquet")["run"])


def table(*folders: str) -> str:
    out = "some-report"
    assert cli.main(["report", *folders, "--format", "csv", "--no-figures", "--out", out]) == 0
    return (Path(out) / "table.csv").read_text()


@pytest.mark.slow
def test_a_study_keeps_its_declared_analysis(first, capsys):
    declared.write(Path("first/outputs/grid"), declared.Declared("success_rate", "pid"))
    assert publish("first/outputs") == 0
    machine("second", ("sac",), (2, 3))
    declared.write(Path("second/outputs/grid"), declared.Declared("success_rate", "ppo"))
    before = files(TO)
    assert publish(TO, "second/outputs") == 2
    assert "its declared analysis would be lost: several analyses are declared" in capsys.readouterr().err
    assert files(TO) == before
    shutil.copy(f"{TO}/{declared.FILE}", "second/outputs/grid")
    assert publish(TO, "second/outputs") == 0
    assert files(TO)[f"{TO}/{declared.FILE}"] == before[f"{TO}/{declared.FILE}"]


@pytest.mark.slow
def test_a_study_that_grows_keeps_its_runs_and_gives_the_numbers_of_all(first, capsys):
    assert publish("first/outputs") == 0
    machine("second", ("sac", "ppo"), (2, 3))
    everything = table("first/outputs", "second/outputs")
    shutil.rmtree("first")
    before = files(TO)
    assert publish("second/outputs") == 2  # the first runs are nowhere else
    assert "would be lost" in capsys.readouterr().err
    assert files(TO) == before
    assert publish(TO, "second/outputs") == 0
    assert len(published()) == 7
    assert (Path(TO) / "table.csv").read_text() == table(TO)
    assert_same_numbers(table(TO), everything)


@pytest.mark.slow
def test_further_protocols_grow_too(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    protocols = {"test": ("nominal",), "robustness": ("nominal", "current=1")}
    for name, algorithms in (("first", ("lqr", "pid")), ("second", ("ppo", "sac"))):
        folder = Path(name) / "outputs" / "grid"
        write_experiment(folder, algorithms=algorithms, seeds=(0, 1), episodes=12, protocols=protocols)
    words = ("--also", "robustness")
    assert publish("first/outputs", *words) == 0
    assert publish(TO, "second/outputs", *words) == 0
    grown = (Path(TO) / "conditions.csv").read_text()
    assert publish("first/outputs", "second/outputs", *words, to="results/at_once") == 0
    assert_same_numbers(grown, Path("results/at_once/conditions.csv").read_text())


@pytest.mark.slow
def test_a_run_directory_counts_before_its_published_copy(first, capsys):
    assert publish("first/outputs") == 0
    capsys.readouterr()
    assert publish(TO, "first/outputs") == 0
    said = capsys.readouterr().out
    for run in first:
        assert f"the report uses {run} and ignores {TO}/{run.name}" in said
    assert "not published" not in said


@pytest.mark.slow
def test_many_runs_that_were_not_tested_are_one_line(first, capsys):
    untested = sorted(machine("more", ("sac",), (0, 1, 2, 3, 4, 5)))
    for run in untested:
        shutil.rmtree(run / "evaluations")
    assert publish("first/outputs", "more/outputs") == 1
    (line,) = (line for line in capsys.readouterr().out.splitlines() if line.startswith("not published: "))
    names = [run.name for run in untested]
    assert f"{', '.join(names[:3])} and 3 more: no evaluation by protocol test" in line
    assert published() == sorted(run.name for run in first)


@pytest.mark.slow
def test_a_damaged_run_never_replaces_a_published_one(first, capsys):
    assert publish("first/outputs") == 0
    (first[0] / "manifest.json").write_text("{")
    set_state([first[1]], "interrupted")
    before = files(TO)
    assert publish("first/outputs") == 2
    assert files(TO) == before
    assert publish(TO, "first/outputs") == 1  # the damaged directory is named, the published run stays
    assert published() == sorted(run.name for run in first)


@pytest.mark.slow
def test_a_choice_removes_nothing(first, capsys):
    assert publish("first/outputs") == 0
    before = files(TO)
    assert publish(TO, "--where", "algo=pid") == 2
    assert "would be lost" in capsys.readouterr().err
    assert files(TO) == before


@pytest.mark.parametrize("to", ["first/outputs", "first/outputs/grid"])
def test_a_folder_of_runs_is_no_place_to_publish_into(first, to, capsys):
    before = files("first")
    assert publish("first/outputs", to=to) == 2
    assert "name a folder without runs" in capsys.readouterr().err
    assert files("first") == before


@pytest.mark.slow
def test_a_training_that_failed_counts_in_the_published_table_too(first):
    set_state([first[2]], "failed", "NaN")
    assert publish("first/outputs") == 0
    assert (Path(TO) / "table.csv").read_text() == table(TO)
    assert_same_numbers(table(TO), table("first/outputs"))
    set_state([first[2]], "complete")
    assert table("first/outputs") != table(TO)

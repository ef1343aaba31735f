"""`auvbench publish` of several folders, again and again: earlier copies stay, and nobody's run is touched."""

from __future__ import annotations

import shutil
from contextlib import nullcontext
from pathlib import Path

import pytest

from auvbench import cli
from auvbench.errors import RunError
from auvbench.runs import lock
from auvbench.runs.directory import RunDirectory
from auvbench.training.execute import execute
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
    return cli.main(["publish", *words, "--to", to, "--pictures", "failures"])


def files(folder: str | Path) -> dict[str, tuple[bytes, int]]:
    return {str(p): (p.read_bytes(), p.stat().st_mtime_ns) for p in Path(folder).rglob("*") if p.is_file()}


def table(*folders: str) -> str:
    out = "some-report"
    assert cli.main(["report", *folders, "--format", "csv", "--no-figures", "--out", out]) == 0
    return (Path(out) / "table.csv").read_text()


def test_real_runs_are_neither_replaced_nor_removed(first, capsys):
    shutil.copytree("first/outputs/grid", "outputs/runs")
    (Path("outputs/runs") / first[0].name / "model").mkdir(exist_ok=True)
    before = files("outputs")
    for source in ("outputs/runs", "first/outputs"):
        assert publish(source, to="outputs") == 2
        said = capsys.readouterr().err
        assert said.count("\n") == 1
        assert "outputs/runs/" in said
        assert "a run, not a copy of one" in said
    assert files("outputs") == before


def test_a_study_that_grows_keeps_its_copies_and_gives_the_numbers_of_all(first, capsys):
    assert publish("first/outputs") == 0
    machine("second", ("sac", "ppo"), (2, 3))
    everything = table("first/outputs", "second/outputs")
    shutil.rmtree("first")
    before = files(f"{TO}/runs")
    capsys.readouterr()
    assert publish(TO, "second/outputs") == 0
    assert "removed" not in capsys.readouterr().out
    after = files(f"{TO}/runs")
    assert {path: after[path] for path in before} == before  # not even written anew
    assert len(list(Path(TO, "runs").iterdir())) == 7
    assert (Path(TO) / "table.csv").read_text() == table(TO)
    assert_same_numbers(table(TO), everything)


@pytest.mark.slow
def test_further_protocols_grow_too_though_their_copies_have_fewer_columns(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    protocols = {"test": ("nominal",), "robustness": ("nominal", "current=1")}
    for name, algorithms in (("first", ("lqr", "pid")), ("second", ("ppo", "sac"))):
        folder = Path(name) / "outputs" / "grid"
        write_experiment(folder, algorithms=algorithms, seeds=(0, 1), episodes=12, protocols=protocols)
    words = ("--also", "robustness")
    assert publish("first/outputs", *words) == 0
    assert publish(TO, "second/outputs", *words) == 0
    grown = (Path(TO) / "robustness" / "conditions.csv").read_text()
    assert publish("first/outputs", "second/outputs", *words, to="results/at_once") == 0
    assert_same_numbers(grown, Path("results/at_once/robustness/conditions.csv").read_text())


def test_of_a_run_in_both_the_run_itself_is_taken(first, capsys):
    assert publish("first/outputs") == 0
    before = {path: data for path, (data, _) in files(f"{TO}/runs").items()}
    capsys.readouterr()
    assert publish(TO, "first/outputs") == 0
    said = capsys.readouterr().out
    for run in first:
        assert f"{run} is reported, {TO}/runs/{run.name} (a shipped copy) is not" in said
    assert "not published" not in said
    assert {path: data for path, (data, _) in files(f"{TO}/runs").items()} == before


def test_a_run_at_work_is_left_out_and_its_earlier_copy_stays(first, capsys):
    assert publish("first/outputs") == 0
    before = files(f"{TO}/runs")[f"{TO}/runs/{first[0].name}/manifest.json"]
    capsys.readouterr()
    with lock.acquire(first[0]):
        assert publish("first/outputs") == 1
        said = capsys.readouterr().out
        assert f"not published: {first[0].name}: " in said
        assert "removed" not in said
        assert files(f"{TO}/runs")[f"{TO}/runs/{first[0].name}/manifest.json"] == before
        assert publish(str(first[0]), to="results/alone") == 1
        assert "works on it at present" in capsys.readouterr().err
    assert not Path("results/alone").exists()


def test_many_runs_that_were_not_tested_are_one_line(first, capsys):
    untested = sorted(machine("more", ("sac",), (0, 1, 2, 3, 4, 5)))
    for run in untested:
        shutil.rmtree(run / "evaluations")
    assert publish("first/outputs", "more/outputs") == 1
    (line,) = (line for line in capsys.readouterr().out.splitlines() if line.startswith("not published: "))
    names = [run.name for run in untested]
    assert f"{', '.join(names[:3])} and 3 more; of the first: no evaluation by protocol test" in line
    assert sorted(p.name for p in Path(TO, "runs").iterdir()) == sorted(run.name for run in first)


def test_a_run_that_is_damaged_or_goes_on_keeps_its_earlier_copy(first, capsys):
    assert publish("first/outputs") == 0
    (first[0] / "manifest.json").write_text("{")
    set_state([first[1]], "interrupted")
    capsys.readouterr()
    assert publish("first/outputs") == 1
    said = capsys.readouterr().out
    assert said.count("not published: ") == 2
    assert sorted(p.name for p in Path(TO, "runs").iterdir()) == sorted(run.name for run in first)


def test_a_damaged_copy_is_named_and_stays(first, capsys):
    assert publish("first/outputs") == 0
    shutil.rmtree("first")
    copy = Path(TO, "runs", first[1].name)
    (copy / "config.yaml").write_text("seed: 77\n")
    assert publish(TO) == 1
    assert f"not published: {copy}: config.yaml" in capsys.readouterr().out
    assert (copy / "evaluations/test/episodes.csv.bz2").is_file()


def test_a_choice_removes_nothing_from_a_folder_that_was_named(first, capsys):
    assert publish("first/outputs") == 0
    before = files(TO)
    assert publish(TO, "--where", "algo=pid") == 2
    assert "--where leaves it out" in capsys.readouterr().err
    assert files(TO) == before
    assert publish("first/outputs", "--where", "algo=pid") == 0  # named by themselves, copies may go
    assert [p.name for p in Path(TO, "runs").iterdir()] == [first[0].name]


@pytest.mark.parametrize("to", ["first/outputs", "first/outputs/grid"])
def test_a_folder_of_runs_is_no_place_to_publish_into(first, to, capsys):
    before = files("first")
    assert publish("first/outputs", to=to) == 2
    assert "lies there itself" in capsys.readouterr().err
    assert files("first") == before


@pytest.mark.parametrize("state", ["complete", "failed"])
def test_nothing_is_trained_in_a_copy(first, capsys, state):
    set_state([first[1]], state)
    assert publish("first/outputs") == 0
    before = files(TO)
    copy = f"{TO}/runs/{first[1].name}"
    capsys.readouterr()
    for words in ([TO], [copy], [copy, "train.total_steps=99999"]):
        assert cli.main(["resume", *words]) == 2
        assert "a copy that auvbench publish made" in capsys.readouterr().err
    with pytest.raises(RunError, match="a copy") if state == "failed" else nullcontext():
        execute(RunDirectory(copy))
    assert cli.main(["runs", TO]) == 0
    assert "interrupted" not in capsys.readouterr().out
    assert files(TO) == before


def test_a_training_that_failed_counts_in_the_published_table_too(first):
    set_state([first[2]], "failed", "NaN")
    assert publish("first/outputs") == 0
    assert (Path(TO) / "table.csv").read_text() == table(TO)
    assert_same_numbers(table(TO), table("first/outputs"))
    set_state([first[2]], "complete")
    assert table("first/outputs") != table(TO)

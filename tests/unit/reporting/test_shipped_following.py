"""What follows from other columns is left out of a copy's rows, and nothing is lost by it; nor by leaving out paths."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from auvbench.analysis import consistency, derived_columns
from auvbench.analysis.evaluations import CORE_COLUMNS
from auvbench.analysis.load import load
from auvbench.cli import main
from auvbench.reporting import shipped
from tests.synthetic import seal, write_experiment

OUT = {"duration_s", "command_norm_sum_N"}


@pytest.fixture
def run(tmp_path: Path) -> Path:
    (run,) = write_experiment(
        tmp_path / "outputs/grid",
        algorithms=("pid",),
        episodes=10,
        train_episodes=0,
        protocols={"test": ("nominal", "1.30"), "robustness": ("nominal",)},
    )
    return run


def ship(run: Path, study: Path, paths: bool = True) -> Path:
    (record,), problems = load([run], ("test", "robustness"))
    assert not problems
    assert shipped.ship(record, study, "test", paths) == []
    return study / "runs" / run.name


def rows(folder: Path, protocol: str = "test") -> pd.DataFrame:
    (record,), problems = load([folder], ("test", "robustness"))
    assert not problems
    return record.evaluations[protocol].episodes


@pytest.mark.parametrize("protocol", ["test", "robustness"])
def test_they_are_not_in_the_file_and_are_read_back(run: Path, tmp_path: Path, protocol: str) -> None:
    copy = ship(run, tmp_path / "study")
    assert not OUT & {*pd.read_csv(copy / f"evaluations/{protocol}/episodes.csv.bz2").columns}
    before, after = rows(run, protocol), rows(copy, protocol)
    order, there = ([name for name in table.columns if name in CORE_COLUMNS] for table in (before, after))
    assert there == order == [*CORE_COLUMNS]
    np.testing.assert_allclose(after["duration_s"], before["duration_s"], rtol=1e-12)
    digits = shipped.DIGITS if protocol == "test" else shipped.FURTHER_DIGITS
    np.testing.assert_allclose(
        after["command_norm_sum_N"], before["command_norm_sum_N"], rtol=0.5 * 10.0 ** (1 - digits)
    )


def test_a_copy_of_a_copy_is_the_same(run: Path, tmp_path: Path) -> None:
    copy = ship(run, tmp_path / "study")
    again = ship(copy, tmp_path / "again")
    for path in copy.rglob("*"):
        if path.is_file():
            assert (again / path.relative_to(copy)).read_bytes() == path.read_bytes()


def test_what_does_not_follow_everywhere_stays(run: Path, tmp_path: Path) -> None:
    file = run / "evaluations/test/episodes.csv"
    frame = pd.read_csv(file, dtype={"condition": str})
    frame.loc[7, "duration_s"] *= 1.001  # of a simulator with a clock of its own
    frame.to_csv(file, index=False)
    summary = file.with_name("summary.json")
    seal(summary, consistency.renewed(json.loads(summary.read_text()), frame))
    copy = ship(run, tmp_path / "study")
    there = pd.read_csv(copy / "evaluations/test/episodes.csv.bz2")
    assert OUT & {*there.columns} == {"duration_s"}
    assert there["duration_s"][7] == pytest.approx(frame["duration_s"][7], rel=1e-3)


@pytest.mark.parametrize(
    ("left_out", "said"),
    [
        (["energy_J"], "summary.json leaves out"),
        ("duration_s", "left_out is"),
        (["duration_s", "command_norm_sum_N", 3], "left_out[2] is 3"),
        ([], "lacks the columns duration_s"),
    ],
)
def test_a_summary_that_leaves_out_something_else(
    run: Path, tmp_path: Path, left_out: object, said: str
) -> None:
    copy = ship(run, tmp_path / "study")
    seal(copy / "evaluations/test/summary.json", left_out=left_out)
    (found,), problems = load([copy])
    assert not found.evaluations
    assert said in problems[0].message


def test_rows_that_have_what_is_left_out(run: Path) -> None:
    seal(run / "evaluations/test/summary.json", left_out=["duration_s"])
    (found,), problems = load([run])
    assert not found.evaluations
    assert "has duration_s, which its summary.json says is left out" in problems[0].message


def test_rows_without_what_it_follows_from() -> None:
    with pytest.raises(ValueError, match="lacks frequency_hz, from which duration_s follows"):
        derived_columns.completed(pd.DataFrame({"steps": [17]}), ["duration_s"])


def test_without_paths(run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    assert (run / "evaluations/test/trajectories.npz").is_file()
    words = ["publish", "outputs/grid", "--to", "study", "--pictures", "failures"]
    assert main([*words, "--no-paths"]) == 0
    copy = tmp_path / "study/runs" / run.name
    assert not list(copy.rglob("*.npz"))
    assert "paths" not in capsys.readouterr().out.splitlines()[-1]
    assert main(["report", "study", "--out", "report"]) == 0
    assert main(words) == 0
    assert list(copy.rglob("*.npz"))

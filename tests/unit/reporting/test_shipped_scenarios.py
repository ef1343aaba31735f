"""What every run of a study meets alike lies in it once: nothing is lost by it, and damage is said."""

from __future__ import annotations

import bz2
import shutil
from pathlib import Path

import pandas as pd
import pytest

from auvbench.analysis.load import load
from auvbench.errors import ReportError
from auvbench.record import SCENARIO_COLUMNS
from auvbench.reporting import copies, shipped
from tests.synthetic import seal, write_evaluation, write_experiment


@pytest.fixture
def runs(tmp_path: Path) -> list[Path]:
    return write_experiment(
        tmp_path / "outputs/grid",
        algorithms=("ppo", "pid"),
        seeds=(0, 1),
        episodes=10,
        train_episodes=0,
        protocols={"test": ("nominal", "1.30")},
    )


def ship(runs: list[Path], study: Path) -> None:
    for record in load(runs)[0]:
        shipped.ship(record, study, "test")
    copies.tidy_scenarios(study)


def tables(study: Path) -> list[str]:
    return sorted(path.name for path in (study / "scenarios").iterdir())


def test_they_lie_there_once_and_are_read_back_with_every_digit(runs: list[Path], tmp_path: Path) -> None:
    study = tmp_path / "study"
    ship(runs, study)
    (name,) = tables(study)
    shared = bz2.decompress((study / "scenarios" / name).read_bytes()).decode()
    assert shared.splitlines()[0] == ",".join(("condition", "episode", *SCENARIO_COLUMNS))
    for run in runs:
        copy = study / "runs" / run.name / "evaluations/test/episodes.csv.bz2"
        assert not {*SCENARIO_COLUMNS} & {*pd.read_csv(copy).columns}
    before, after = (
        {r.id: r.evaluations["test"].episodes for r in load([p])[0]} for p in (runs[0].parent, study)
    )
    assert len(after) == len(runs) == 3
    for run, rows in before.items():
        known = ["condition", "episode", *SCENARIO_COLUMNS]
        pd.testing.assert_frame_equal(after[run][known], rows[known], check_exact=True)
        assert {*after[run].columns} == {*rows.columns}


def test_runs_that_met_others_have_a_table_of_their_own_until_nobody_names_it(
    runs: list[Path], tmp_path: Path
) -> None:
    study = tmp_path / "study"
    write_evaluation(runs[0], "test", ("nominal", "1.30"), 12)
    ship(runs, study)
    assert len(tables(study)) == 2
    (study / "scenarios/notes.csv.bz2").write_bytes(b"mine")
    write_evaluation(runs[0], "test", ("nominal", "1.30"), 10)
    ship(runs, study)
    assert len(tables(study)) == 2
    assert "notes.csv.bz2" in tables(study)
    assert not load([study])[1]


def test_of_a_further_protocol_nothing_is_named(runs: list[Path], tmp_path: Path) -> None:
    study = tmp_path / "study"
    write_evaluation(runs[0], "robustness", ("nominal",), 10)
    (record,), _ = load(runs[:1], ("test", "robustness"))
    shipped.ship(record, study, "test")
    (copy,), problems = load([study], ("test", "robustness"))
    assert not problems
    assert "waypoint_x_m" in copy.evaluations["test"].episodes
    assert "waypoint_x_m" not in copy.evaluations["robustness"].episodes
    shipped.ship(copy, tmp_path / "turned", "robustness")  # of whose rows the columns are gone
    assert not (tmp_path / "turned/scenarios").exists()
    assert load([tmp_path / "turned"], ("robustness",))[0][0].evaluations


def test_published_from_copies_they_are_the_same(runs: list[Path], tmp_path: Path) -> None:
    ship(runs, tmp_path / "study")
    ship([tmp_path / "study"], tmp_path / "again")
    for path in (tmp_path / "study").rglob("*"):
        if path.is_file():
            assert (
                tmp_path / "again" / path.relative_to(tmp_path / "study")
            ).read_bytes() == path.read_bytes()


@pytest.mark.parametrize("fault", ["missing", "changed", "cut short", "of another test", "no digest", "both"])
def test_no_row_without_its_scenario_enters_a_table(runs: list[Path], tmp_path: Path, fault: str) -> None:
    study = tmp_path / "study"
    ship(runs, study)
    (name,) = tables(study)
    file = study / "scenarios" / name
    copy = study / "runs" / runs[0].name / "evaluations/test"
    said = f"scenarios/{name}"
    if fault == "missing":
        shutil.rmtree(study / "scenarios")
    elif fault == "changed":
        file.write_bytes(
            bz2.compress(bz2.decompress(file.read_bytes()).replace(b"nominal,3", b"nominal,4", 1))
        )
    elif fault == "cut short":
        file.write_bytes(file.read_bytes()[:-9])
    elif fault == "of another test":
        digest = copies.put_scenarios(b"condition,episode,start_yaw_rad\nnominal,0,0.5\n", study)
        seal(copy / "summary.json", scenarios_sha256=digest)
        said = "does not have the scenario of every episode"
    elif fault == "no digest":
        seal(copy / "summary.json", scenarios_sha256="../../secret")
        said = "which is no digest"
    else:
        rows = b"condition,episode,steps\n" + b"".join(
            f"{c},{e},17\n".encode() for c in ("nominal", "1.30") for e in range(10)
        )
        seal(copy / "summary.json", scenarios_sha256=copies.put_scenarios(rows, study))
        said = "holds no scenarios"
    found, problems = load([study])
    alone = fault in ("of another test", "no digest", "both")
    assert sum(not run.evaluations for run in found) == (1 if alone else 3)
    assert {problem.kind for problem in problems} == {"damaged"}
    assert all(said in problem.message for problem in problems)


def test_a_link_in_their_place_is_refused(runs: list[Path], tmp_path: Path) -> None:
    study = tmp_path / "study"
    ship(runs, study)
    (study / "scenarios").rename(tmp_path / "elsewhere")
    (study / "scenarios").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(ReportError, match="symbolic link"):
        copies.prepare(study)

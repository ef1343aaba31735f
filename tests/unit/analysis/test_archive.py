"""Published studies: damaged and hostile Parquet files are named, and no row of them enters a table."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from pyarrow import parquet as files

from auvbench import cli
from auvbench.analysis import archive
from auvbench.analysis.damage import Damage
from auvbench.analysis.load import load
from auvbench.errors import ReportError
from auvbench.untrusted import tables
from tests.conftest import Once
from tests.synthetic import write_experiment


def published(folder: Path) -> None:
    runs = folder / "outputs/grid"
    write_experiment(
        runs, algorithms=("pid", "ppo"), seeds=(0, 1), protocols={"test": ("nominal",)}, train_episodes=5
    )
    assert (
        cli.main(["publish", str(runs), "--to", str(folder / "study"), "--pictures", "success_over_time"])
        == 0
    )


@pytest.fixture
def study(once: Once, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    shutil.copytree(once("study", published), tmp_path, dirs_exist_ok=True)
    return tmp_path / "study"


def change(study: Path, name: str, edit) -> None:  # type: ignore[no-untyped-def]
    """Edit a table and make the digests fit, as an attacker would."""
    files = {each: (study / each).read_bytes() for each in (archive.EPISODES, archive.TRAJECTORIES)}
    runs, _ = tables.read_parquet((study / archive.RUNS).read_bytes())
    if name == archive.RUNS:
        runs = edit(runs.astype(object))
    else:
        frame, _ = tables.read_parquet((study / name).read_bytes())
        files[name] = tables.parquet(edit(frame), {})
        (study / name).write_bytes(files[name])
    (study / archive.RUNS).write_bytes(tables.parquet(runs, archive.note(runs, files)))


@pytest.mark.slow
def test_pandas_opens_it(study: Path) -> None:
    rows = pd.read_parquet(study / "episodes.parquet")
    success = (
        rows[rows["protocol"] == "test"].groupby("run")["outcome"].apply(lambda o: (o == "success").mean())
    )
    (runs, _) = load([study])
    assert {run.id: float(success[run.id]) for run in runs} == {
        run.id: run.evaluations["test"].summary["conditions"][0]["success_rate"] for run in runs
    }


@pytest.mark.parametrize("name", [archive.RUNS, archive.EPISODES])
@pytest.mark.parametrize("fault", ["cut", "empty", "link", "pipe"])
def test_a_damaged_file_is_named(study: Path, name: str, fault: str) -> None:
    file = study / name
    data = file.read_bytes()
    file.unlink()
    if fault == "cut":
        file.write_bytes(data[: len(data) // 2])
    elif fault == "empty":
        file.write_bytes(b"")
    elif fault == "link":
        file.symlink_to(study / "table.csv")
    else:
        os.mkfifo(file)
    try:
        runs, problems = load([study])
    except ReportError:
        return
    assert not any(run.evaluations for run in runs)
    assert any("parquet" in problem.message for problem in problems)


@pytest.mark.parametrize("name", [archive.RUNS, archive.EPISODES])
def test_a_flipped_bit_is_named_or_changes_nothing(study: Path, name: str) -> None:
    file = study / name
    data = file.read_bytes()
    sound = contents(study)
    for position in range(0, len(data), len(data) // 40):
        file.write_bytes(data[:position] + bytes([data[position] ^ 4]) + data[position + 1 :])
        try:
            found = contents(study)
        except Damage:
            continue
        assert found == sound, position


def contents(study: Path) -> list[str]:
    found = archive.Archive(study)
    texts = [json.dumps(found.document(run, "manifest")) for run in found.ids()]
    return texts + [found.episodes(run, "test").to_csv() for run in found.ids()]


@pytest.mark.parametrize("column", ["config", "manifest", "evaluations"])
@pytest.mark.parametrize("value", ["", "null", "[]", "[" * 100_000, json.dumps({"id": "x"}), "\udcff"])
def test_a_run_with_foreign_json_is_named(study: Path, column: str, value: str) -> None:
    def edit(frame: pd.DataFrame) -> pd.DataFrame:
        frame.loc[0, column] = value.encode("utf-8", "replace").decode()
        return frame

    change(study, archive.RUNS, edit)
    runs, problems = load([study])
    assert len([run for run in runs if run.evaluations]) == 2
    assert problems


def test_a_long_text_in_every_row_is_in_memory_once(tmp_path: Path) -> None:
    texts = pa.DictionaryArray.from_arrays(pa.array([0] * 1000), pa.array(["x" * 10**6]))
    files.write_table(pa.table({"run": texts}), tmp_path / "small.parquet", store_schema=False)
    frame, _ = tables.read_parquet((tmp_path / "small.parquet").read_bytes())
    assert isinstance(frame["run"].dtype, pd.CategoricalDtype)


def test_nested_columns_are_refused(tmp_path: Path) -> None:
    files.write_table(pa.table({"run": [["a"], ["b"]]}), tmp_path / "nested.parquet")
    with pytest.raises(ValueError, match="type"):
        tables.read_parquet((tmp_path / "nested.parquet").read_bytes())


def test_trajectories_are_read_back_to_a_millimetre(study: Path) -> None:
    from auvbench.analysis.recorded import paths

    plain, _ = load(["outputs/grid"])
    published, _ = load([study])
    for before, after in zip(plain, published, strict=True):
        one = list(paths(before, "test", "nominal", 3))
        other = list(paths(after, "test", "nominal", 3))
        assert [path.episode for path in one] == [path.episode for path in other]
        for path, near in zip(one, other, strict=True):
            assert path.waypoint == pytest.approx(near.waypoint, abs=1e-3)
            assert np.abs(path.position - near.position).max() <= 6e-4
            assert np.abs(path.time - near.time).max() <= 6e-4


def test_rows_in_disorder_are_those_of_their_runs(study: Path) -> None:
    def rows() -> pd.DataFrame:
        found = archive.Archive(study)
        return found.episodes(found.ids()[0], "test").sort_values("episode", ignore_index=True)

    before = rows()
    change(study, archive.EPISODES, lambda frame: frame.sample(frac=1.0, random_state=1))
    pd.testing.assert_frame_equal(rows(), before)

"""Published studies whose digests fit and whose tables do not: each ends in one line, never in a defect."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from auvbench import cli
from auvbench.analysis import archive
from auvbench.analysis.damage import Damage
from auvbench.analysis.load import load
from auvbench.analysis.recorded import paths, read_validation_curve, training
from auvbench.errors import ReportError
from auvbench.untrusted import sandbox, tables
from tests.conftest import Once
from tests.unit.analysis.test_archive import published

QUICK = ("frequency_hz text", "steps twice", "episode null", "episode text", "run twice")
SHORT = (
    *QUICK,
    "20,000 columns",
    "validation text",
    "return text",
    "waypoint_x_m absent",
    "t_ms text",
    "config text",
)
"""Endings of the names of some of the faults"""
TABLES = (archive.RUNS, archive.EPISODES, archive.TRAJECTORIES)


def constant(value: Any, kind: pa.DataType) -> Callable[[pa.ChunkedArray], pa.Array]:
    return lambda column: pa.array([value] * len(column), kind)


def first(value: Any) -> Callable[[pa.ChunkedArray], pa.Array]:
    """The column with another value in its first row."""
    return lambda column: pa.array([value, *column.to_pylist()[1:]], column.type)


FAULTS: dict[str, Callable[[pa.ChunkedArray], pa.Array]] = {
    "null": first(None),
    "all null": lambda column: pa.nulls(len(column), column.type),
    "text": constant("=1+1\x1b[31m", pa.string()),
    "whole numbers": constant(7, pa.int64()),
    "least whole number": constant(-(2**63), pa.int64()),
    "unsigned": constant(2**64 - 1, pa.uint64()),
    "huge": constant(1e300, pa.float64()),
    "infinite": constant(np.inf, pa.float64()),
    "negative": constant(-1.5, pa.float64()),
    "truth": constant(True, pa.bool_()),
    "lists": constant([1, 2], pa.list_(pa.int64())),
    "dates": constant(0, pa.timestamp("ns")),
}
COLUMNS = {
    archive.RUNS: ("run", "config", "manifest", "evaluations", "validation"),
    archive.EPISODES: (
        "run", "protocol", "condition", "episode", "outcome", "steps", "frequency_hz", "return", "waypoint_x_m",
    ),
    archive.TRAJECTORIES: ("run", "condition", "episode", "t_ms", "x_mm"),
}  # fmt: skip


def of_columns() -> Iterator[tuple[str, str, Callable[[pa.Table], pa.Table]]]:
    """Table, name and edit of each hostile study."""
    for name, columns in COLUMNS.items():
        for column in columns:
            for fault, made in FAULTS.items():
                yield name, f"{column} {fault}", _replaced(column, made)
            yield name, f"{column} absent", _without(column)
            yield name, f"{column} twice", _twice(column)
        yield name, "20,000 columns", _wide
        yield name, "no rows", lambda table: table.slice(0, 0)
        yield name, "rows twice", lambda table: pa.concat_tables([table, table])


def _replaced(column: str, made: Callable[[pa.ChunkedArray], pa.Array]) -> Callable[[pa.Table], pa.Table]:
    return lambda table: table.set_column(table.schema.get_field_index(column), column, made(table[column]))


def _without(column: str) -> Callable[[pa.Table], pa.Table]:
    return lambda table: table.drop_columns([column])


def _twice(column: str) -> Callable[[pa.Table], pa.Table]:
    return lambda table: table.append_column(column, table[column])


def _wide(table: pa.Table) -> pa.Table:
    more = [pa.nulls(len(table), pa.float64())] * 20_000
    return pa.Table.from_arrays(
        [*table.columns, *more], [*table.column_names, *(f"c{i}" for i in range(20_000))]
    )


def seal(study: Path) -> None:
    """Make the digests fit, as an attacker would."""
    files = {name: (study / name).read_bytes() for name in TABLES[1:]}
    table = parquet.ParquetFile(study / archive.RUNS).read()
    frame = (
        table.replace_schema_metadata(None).to_pandas()
        if len(set(table.column_names)) == table.num_columns
        else None
    )
    note = {} if frame is None else archive.note(frame, files)
    parquet.write_table(table.replace_schema_metadata(note), study / archive.RUNS, store_schema=False)


@pytest.fixture
def study(once: Once, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    shutil.copytree(once("study", published), tmp_path, dirs_exist_ok=True)
    return tmp_path / "study"


def spoiled(study: Path, ends: str | tuple[str, ...]) -> Iterator[tuple[str, Path]]:
    """Yield the name and the folder of each hostile study, which is sound again afterwards."""
    sound = {name: (study / name).read_bytes() for name in TABLES}
    for name, what, edit in of_columns():
        if not what.endswith(ends):
            continue
        for each, data in sound.items():
            (study / each).write_bytes(data)
        table = parquet.ParquetFile(study / name).read()
        try:
            changed = edit(table.replace_schema_metadata(None))
        except (pa.ArrowInvalid, pa.ArrowTypeError, pa.ArrowNotImplementedError):
            continue
        parquet.write_table(changed, study / name, store_schema=False)
        seal(study)
        yield f"{name}: {what}", study


@pytest.mark.parametrize("all_of_them", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_what_a_report_reads_of_a_hostile_study_is_damage_or_numbers(study: Path, all_of_them: bool) -> None:
    count = 0
    for what, folder in spoiled(study, "" if all_of_them else QUICK):
        count += 1
        try:
            runs, problems = load([folder])
        except ReportError:
            continue
        for problem in problems:
            assert problem.message.isprintable(), what
        for run in runs:
            for evaluation in run.evaluations.values():
                assert np.isfinite(evaluation.episodes["steps"].to_numpy()).all(), what
                if run.source.has_paths(evaluation.protocol):
                    with contextlib.suppress(Damage):
                        for path in paths(run, evaluation.protocol, "nominal", 3):
                            assert np.isfinite(path.position).all(), what
            for read in (training, read_validation_curve):
                with contextlib.suppress(Damage):
                    read(run)
    assert count >= (200 if all_of_them else len(QUICK))


@pytest.mark.slow
def test_a_report_and_a_copy_of_a_hostile_study_end_in_lines(
    study: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    for what, folder in spoiled(study, SHORT):
        for command in (
            ["report", str(folder), "--no-figures", "--out", str(tmp_path / "report")],
            ["publish", str(folder), "--to", str(tmp_path / "again"), "--pictures", "success_over_time"],
        ):
            code = cli.main(command)
            said = capsys.readouterr().err
            assert code in (0, 2), f"{what}: {command[0]} ends with {code}: {said}"
            assert "Traceback" not in said
            assert all(line.startswith("auvbench: ") for line in said.splitlines()), f"{what}: {said}"


@pytest.mark.parametrize(("rows", "columns"), [(50_000_000, 1), (2_000_000, 40)], ids=["long", "wide"])
def test_a_small_file_that_unpacks_without_end_is_one_line(
    rows: int, columns: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = pa.array(np.zeros(100_000))
    long = pa.chunked_array([one] * (rows // len(one)))
    table = pa.table({f"c{i}": long for i in range(columns)})
    parquet.write_table(table, tmp_path / "bomb.parquet", compression="zstd", row_group_size=rows)
    data = (tmp_path / "bomb.parquet").read_bytes()
    assert len(data) < 1024**2
    monkeypatch.setattr(sandbox, "MEMORY", 64 * 1024**2)
    with pytest.raises(ValueError, match=r"(unpacks to|needs) more than 64 MiB"):
        tables.read_parquet(data)


def test_a_footer_that_lies_is_one_line(tmp_path: Path) -> None:
    """The footer says that the pages are small; what they unpack to is not."""
    table = pa.table({"steps": pa.array(np.zeros(20_000_000))})
    parquet.write_table(table, tmp_path / "lie.parquet", compression="zstd", use_dictionary=False)
    data = (tmp_path / "lie.parquet").read_bytes()
    said = parquet.read_metadata(pa.BufferReader(data)).row_group(0).total_byte_size
    lying = data.replace(
        _zigzag(said), _zigzag(1000).ljust(len(_zigzag(said)), b"\x00")[: len(_zigzag(said))]
    )
    with pytest.raises(ValueError, match=r"^[^\n]+$"):
        tables.read_parquet(lying)


def _zigzag(number: int) -> bytes:
    """A number as Thrift writes it."""
    number, out = number << 1, bytearray()
    while number > 127:
        out.append(number & 127 | 128)
        number >>= 7
    return bytes([*out, number])

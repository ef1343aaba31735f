"""Read a published study: its runs, test episodes and trajectories in three Parquet files.

    runs.parquet          a row per run: configuration, manifest and summaries as JSON
    episodes.parquet      a row per episode; `protocol` is "train" for training episodes
    trajectories.parquet  a row per step of the first test episodes (optional)

The footer of runs.parquet has the sizes and digests of the other two files.
"""

from __future__ import annotations

import json
import operator
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd

from auvbench.analysis.damage import Damage, named
from auvbench.record import columns
from auvbench.runs import integrity
from auvbench.runs.atomic_io import sha256
from auvbench.untrusted import columns as schemas
from auvbench.untrusted import reading, tables, typed_json
from auvbench.untrusted.text import short

RUNS, EPISODES, TRAJECTORIES = "runs.parquet", "episodes.parquet", "trajectories.parquet"
TRAIN = "train"
"""name of the protocol of training episodes"""
NOTE = "auvbench"
"""key of the note in the footer of runs.parquet"""

FOLLOWING: dict[str, tuple[str, Callable[[Any, Any], Any], str]] = {
    "duration_s": ("steps", operator.truediv, "frequency_hz"),
    "command_norm_sum_N": ("steps", operator.mul, "command_norm_mean_N"),
}
"""formulas of the columns that are not stored: first stored column, operation, second stored column"""
SCALE = {"t_ms": 1e-3, "x_mm": 1e-3, "y_mm": 1e-3, "z_mm": 1e-3}
"""columns of trajectories.parquet (whole milliseconds and millimetres), with the factor that converts each to s or m"""


@dataclass(frozen=True, slots=True)
class Note:
    """Footer of runs.parquet."""

    content: str
    """digest of the column names and cells of runs.parquet"""
    files: dict[str, integrity.FileEntry]
    """entries of the other Parquet files"""
    schema_version: Annotated[int, typed_json.Range(1, 1)] = 1


def is_archive(folder: Path) -> bool:
    """Return whether a folder contains a published study."""
    return (folder / RUNS).is_file() and not (folder / RUNS).is_symlink()


class Archive:
    """Reader of a published study.

    Args:
        folder: folder with the three files.

    Raises:
        Damage: runs.parquet cannot be used.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        with named(RUNS):
            frame, notes = tables.read_parquet(reading.content(folder / RUNS, tables.FILE))
        with named(f"the footer of {RUNS}"):
            note = typed_json.convert(reading.json_value(notes.get(NOTE, "null").encode()), Note)
        if note.content != digest(frame):
            raise Damage(f"{RUNS} was changed or damaged")
        self._files = {integrity.FILES: {name: asdict(entry) for name, entry in note.files.items()}}
        with named(RUNS):
            frame = schemas.checked(frame, schemas.RUNS)
        names = frame["run"].astype(object)
        if names.duplicated().any():
            raise Damage(f"{RUNS} names a run twice")
        self._rows = frame.astype(object).set_index(names)

    def __reduce__(self) -> tuple[type[Archive], tuple[Path]]:
        return Archive, (self.folder,)

    def ids(self) -> list[str]:
        """Return the ids of the runs."""
        return [str(name) for name in self._rows.index]

    def document(self, run: str, column: str) -> Any:
        """Return a JSON value of a run: `config`, `manifest`, `evaluations` or `validation`.

        Raises:
            Damage: the text is not valid JSON.
        """
        with named(f"{RUNS}: {column} of {short(run, 60)}"):
            return reading.json_value(str(self._rows.loc[run, column]).encode())

    def summaries(self, run: str) -> dict[str, Any]:
        """Return the summary of each evaluation of a run, by protocol.

        Raises:
            Damage: the summaries are not a JSON object.
        """
        summaries = self.document(run, "evaluations")
        if not isinstance(summaries, dict):
            raise Damage(f"{RUNS}: evaluations of {short(run, 60)} is not a JSON object")
        return summaries

    def episodes(self, run: str, protocol: str) -> pd.DataFrame:
        """Return a run's test episodes by a protocol, or its training episodes for `TRAIN`.

        The table has the same columns as the file of episodes in the run's directory.

        Raises:
            Damage: episodes.parquet cannot be used.
        """
        rows = self._episodes_of.get((run, protocol))
        if rows is None:
            return self._episodes.iloc[:0]
        frame = self._episodes.take(rows).drop(columns=["run", "protocol"])
        frame = frame.dropna(axis="columns", how="all").reset_index(drop=True)
        for name in frame.columns:
            if isinstance(frame[name].dtype, pd.CategoricalDtype):
                frame[name] = frame[name].astype(object)
        for name, (first, operation, other) in FOLLOWING.items():
            if {first, other} <= set(frame.columns):
                frame[name] = operation(frame[first], frame[other])
        registered = [name for name in columns() if name in frame.columns]
        return frame[[*(name for name in frame.columns if name not in registered), *registered]]

    def paths(self, run: str, protocol: str, condition: str) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
        """Yield number, positions (T + 1, 3) m and times (T + 1,) s of each stored episode.

        Raises:
            Damage: trajectories.parquet cannot be used.
        """
        if not self.has_paths:
            return
        rows = self._trajectories_of.get((run, protocol, condition))
        if rows is None:
            return
        frame = self._trajectories.take(rows)
        episodes = frame["episode"].to_numpy()
        values = {name: frame[name].to_numpy(dtype=np.float64) * unit for name, unit in SCALE.items()}
        for episode in dict.fromkeys(episodes.tolist()):
            in_episode = episodes == episode
            position = np.stack([values[name][in_episode] for name in ("x_mm", "y_mm", "z_mm")], axis=1)
            yield int(episode), position, values["t_ms"][in_episode]

    def has_training(self, run: str) -> bool:
        """Return whether the study stores training episodes of a run."""
        return (run, TRAIN) in self._episodes_of

    @property
    def has_paths(self) -> bool:
        """Return whether the study has stored trajectories."""
        return (self.folder / TRAJECTORIES).is_file()

    @cached_property
    def _episodes(self) -> pd.DataFrame:
        return self._table(EPISODES, schemas.of_study())

    @cached_property
    def _episodes_of(self) -> Mapping[Any, Any]:
        return self._episodes.groupby(["run", "protocol"], observed=True).indices

    @cached_property
    def _trajectories(self) -> pd.DataFrame:
        return self._table(TRAJECTORIES, schemas.TRAJECTORIES)

    @cached_property
    def _trajectories_of(self) -> Mapping[Any, Any]:
        return self._trajectories.groupby(["run", "protocol", "condition"], observed=True).indices

    def _table(self, name: str, schema: schemas.Schema) -> pd.DataFrame:
        with named(name):
            data = reading.content(self.folder / name, tables.FILE)
            if wrong := integrity.difference(self._files, name, data):
                raise Damage(f"{name} {wrong}")
            return schemas.checked(tables.read_parquet(data, schema)[0], schema)


def note(runs: pd.DataFrame, files: Mapping[str, bytes]) -> dict[str, str]:
    """Return the footer of runs.parquet, computed from the rows of runs.parquet and the other files of a study."""
    entries = {name: integrity.FileEntry(**integrity.entry(data)) for name, data in files.items()}
    return {NOTE: json.dumps(asdict(Note(digest(runs), entries)), sort_keys=True)}


def digest(runs: pd.DataFrame) -> str:
    """Return the SHA-256 of the column names and cells of a table."""
    cells = [*runs.columns, *(str(cell) for name in runs.columns for cell in runs[name].tolist())]
    return sha256("\0".join(cells).encode("utf-8", "surrogatepass"))

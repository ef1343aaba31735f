"""Read the files of one run from its run directory or from a published study."""

from __future__ import annotations

import csv
import io
import itertools
import re
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from auvbench import metrics
from auvbench.analysis.archive import EPISODES, RUNS, TRAIN, Archive
from auvbench.analysis.damage import Damage, check_digest, finite, named
from auvbench.config.tasks.formation import MOST as MOST_VEHICLES
from auvbench.runs import integrity
from auvbench.runs.directory import RunDirectory
from auvbench.statistics.intervals import FloatArray
from auvbench.untrusted import archives, columns, path_safety, reading, tables, typed_json
from auvbench.untrusted.text import short

NAME = "trajectories.npz"
REQUIRED = ("waypoint", "position", "time")
OPTIONAL = ("reference", "dock_yaw", "outlines", "yaw", "command", "others")


@dataclass(frozen=True, slots=True, eq=False)
class StoredPath:
    """Trajectory of a vehicle or of a team in one test episode."""

    episode: int
    waypoint: tuple[float, float, float]  # m; goal position in tasks without waypoints
    position: FloatArray  # (T + 1, 3) m
    time: FloatArray  # (T + 1,) s
    reference: FloatArray | None = None  # (T + 1, 3) m, of a moving reference; missing in a published study
    dock_yaw: float | None = None  # rad; missing in a published study
    outlines: FloatArray | None = None  # (k, 2, 3) m, ends of segments; missing in a published study
    yaw: FloatArray | None = None  # (T + 1,) rad; missing in a published study
    command: FloatArray | None = None  # (T, n_u) N; missing in a published study
    # (T + 1, V - 1, 3) m, the other vehicles of a team; missing in a published study
    others: FloatArray | None = None


TRAINING, VALIDATION = "train/episodes.csv", "train/validation.csv"

Test = tuple[dict[str, Any], pd.DataFrame]
"""summary of a test, and a table with one row per episode"""


class RunSource(ABC):
    """Files of one run. Every method raises `Damage` if a file cannot be used, was changed, or disagrees with another file."""

    directory: Path
    """folder of the run, which messages show; for a run of a published study, the folder does not exist"""
    published: bool
    """whether the run is part of a published study, which does not contain the weights of policies"""

    @property
    @abstractmethod
    def record(self) -> Path:
        """Return the file or folder to show to a user as the run's record."""

    @abstractmethod
    def config(self) -> dict[str, Any]:
        """Return the nested configuration."""

    @abstractmethod
    def protocols(self) -> list[str]:
        """Return the names of the protocols by which the run was tested."""

    @abstractmethod
    def test(self, protocol: str) -> Test:
        """Return the summary and the episodes of the run's test by a protocol."""

    @abstractmethod
    def has_paths(self, protocol: str) -> bool:
        """Return whether trajectories of a test are stored."""

    @abstractmethod
    def paths(
        self, protocol: str, condition: str, episodes: int, tested: pd.DataFrame
    ) -> Iterator[StoredPath]:
        """Yield the stored trajectories of one condition, at most `episodes`, without loading any pickle.

        Args:
            protocol: name of the protocol.
            condition: test condition.
            episodes: largest number of trajectories.
            tested: table of the test's episodes.
        """

    @abstractmethod
    def has_training(self) -> bool:
        """Return whether the run has stored training episodes."""

    @abstractmethod
    def training(self, manifest: Mapping[str, Any]) -> pd.DataFrame:
        """Return the training episodes, with the columns that a report uses.

        The table may be empty: in a short training, no episode may end.
        """

    @abstractmethod
    def validation(self) -> list[dict[str, Any]]:
        """Return one row for each validation during the training."""


class RunFolder(RunSource):
    """A run directory.

    Args:
        directory: the folder.
    """

    published = False

    def __init__(self, directory: Path) -> None:
        self.directory = directory

    @property
    def record(self) -> Path:
        manifest = self.directory / "manifest.json"
        return manifest if manifest.is_file() else self.directory

    def config(self) -> dict[str, Any]:
        return RunDirectory(self.directory).config()

    def protocols(self) -> list[str]:
        return sorted(path.parent.name for path in self.directory.glob("evaluations/*/summary.json"))

    def test(self, protocol: str) -> Test:
        directory = path_safety.child(self.directory / "evaluations", protocol)
        schema = columns.of_test()
        with named("summary.json"):
            summary = integrity.read(directory / "summary.json", integrity.Summary)
        with named("episodes.csv"):
            data = reading.content(directory / "episodes.csv", reading.DATA)
            # Read the condition as text, because a name such as 1.30 would become the number 1.3.
            frame = tables.csv(data, schema, words=("condition",))
            if not data.endswith(b"\n") or _is_partial(frame):
                raise Damage(f"episodes.csv is cut short: the last of its {len(frame)} rows is incomplete")
            frame = columns.checked(frame, schema)
        _check_episodes(frame, summary)
        check_digest(summary, "episodes.csv", data)
        return summary, frame

    def has_paths(self, protocol: str) -> bool:
        return (self._test(protocol) / NAME).is_file()

    def paths(
        self, protocol: str, condition: str, episodes: int, tested: pd.DataFrame
    ) -> Iterator[StoredPath]:
        yield from _of_file(self._test(protocol) / NAME, condition, episodes)

    def has_training(self) -> bool:
        return (self.directory / TRAINING).exists()

    def training(self, manifest: Mapping[str, Any]) -> pd.DataFrame:
        with named(TRAINING):
            data = reading.content(self.directory / TRAINING, reading.DATA)
            frame = columns.checked(tables.csv(data, columns.TRAINING), columns.TRAINING)
        check_digest(manifest, TRAINING, data)
        return frame

    def validation(self) -> list[dict[str, Any]]:
        path = self.directory / VALIDATION
        with named(VALIDATION):
            if not path.exists():
                return []
            return list(csv.DictReader(io.StringIO(reading.content(path).decode("utf-8"))))

    def _test(self, protocol: str) -> Path:
        return path_safety.child(self.directory / "evaluations", protocol)


class PublishedRun(RunSource):
    """A run in a published study.

    Args:
        study: the study.
        run: id of the run.
    """

    published = True

    def __init__(self, study: Archive, run: str) -> None:
        self.study, self.run = study, run
        self.directory = path_safety.child(study.folder, run)

    @property
    def record(self) -> Path:
        return self.study.folder / RUNS

    def config(self) -> dict[str, Any]:
        document: dict[str, Any] = self.study.document(self.run, "config")
        return document

    def protocols(self) -> list[str]:
        return sorted(self.study.summaries(self.run))

    def test(self, protocol: str) -> Test:
        with named(f"the summary of {short(protocol, 40)}"):
            summary = integrity.checked(self.study.summaries(self.run)[protocol], integrity.Summary)
        with named(f"episodes of {short(self.run, 60)} by {short(protocol, 40)}"):
            frame = columns.checked(self.study.episodes(self.run, protocol), columns.of_test())
        _check_episodes(frame, summary)
        return summary, frame

    def has_paths(self, protocol: str) -> bool:
        return self.study.has_paths

    def paths(
        self, protocol: str, condition: str, episodes: int, tested: pd.DataFrame
    ) -> Iterator[StoredPath]:
        rows = tested[tested["condition"] == condition].set_index("episode")
        goal = "waypoint" if "waypoint_x_m" in rows.columns else "goal"
        with named(EPISODES):
            waypoints = rows[[f"{goal}_{axis}_m" for axis in "xyz"]].to_numpy(dtype=np.float64)
        where = {int(episode): i for i, episode in enumerate(rows.index)}
        stored = self.study.paths(self.run, protocol, condition)
        for episode, position, time in itertools.islice(stored, episodes):
            if episode not in where:
                raise Damage(f"trajectories of episode {episode}, which was not tested")
            x, y, z = waypoints[where[episode]].tolist()
            yield StoredPath(episode, (x, y, z), position, time)

    def has_training(self) -> bool:
        return self.study.has_training(self.run)

    def training(self, manifest: Mapping[str, Any]) -> pd.DataFrame:
        frame = self.study.episodes(self.run, TRAIN)
        with named(TRAINING):
            return columns.checked(frame, columns.TRAINING)

    def validation(self) -> list[dict[str, Any]]:
        with named(VALIDATION):
            rows = self.study.document(self.run, "validation") or []
            return typed_json.convert(rows, list[dict[str, Any]])


def _is_partial(frame: pd.DataFrame) -> bool:
    """Return whether the last row is incomplete: it lacks a value in the last column.

    A missing value in a conditional column is allowed if all rows of the condition lack it.
    """
    last = str(frame.columns[-1])
    if not len(frame) or not frame[last].isna().iloc[-1]:
        return False
    conditional = any(m.name == last and m.conditional for m in metrics.registered())
    in_condition = frame["condition"] == frame["condition"].iloc[-1]
    return not conditional or bool(frame.loc[in_condition, last].notna().any())


def _check_episodes(frame: pd.DataFrame, summary: Mapping[str, Any]) -> None:
    """Check the rows of a test against its summary.

    Raises:
        Damage: the summary has no conditions, an episode is missing or present twice, or a conditional column is
            missing in only some rows of a condition.
    """
    expected = {c["name"]: c["episodes"] for c in summary["conditions"]}
    if len(expected) < max(1, len(summary["conditions"])):
        raise Damage("summary.json has no conditions, or a condition twice")
    conditions = frame["condition"].tolist()
    counts = Counter(conditions)
    for name in [*expected, *counts]:
        if counts[name] != expected.get(name, 0):
            raise Damage(
                f"episodes.csv has {counts[name]} episodes of condition {name!r}, "
                f"summary.json says {expected.get(name, 0)}: evaluate again"
            )
    if len(set(zip(conditions, frame["episode"].tolist(), strict=True))) < len(frame):
        raise Damage("episodes.csv has an episode of a condition twice: evaluate again")
    for metric in metrics.registered():
        if metric.conditional and metric.name in frame:
            lacking = frame[metric.name].isna().groupby(frame["condition"]).mean()
            for name in lacking.index[(lacking > 0.0) & (lacking < 1.0)]:
                raise Damage(
                    f"episodes.csv: {metric.name} is missing in some rows of condition {name!r}: evaluate again"
                )


def _of_file(file: Path, condition: str, episodes: int) -> Iterator[StoredPath]:
    with named(file.name):
        data = reading.content(file, reading.DATA)
        arrays = archives.paths(data, condition, episodes)
        named_so = re.compile(rf"position_{re.escape(condition)}_(\d+)")
        numbers = sorted(int(match[1]) for key in arrays if (match := named_so.fullmatch(key)))
        episodes_read = [
            _episode(arrays, f"{condition}_{episode}", episode) for episode in numbers[:episodes]
        ]
    # The digest is checked last, because the checks above give more specific messages.
    with named("summary.json"):
        summary = integrity.read(file.with_name("summary.json"), integrity.Summary)
    check_digest(summary, file.name, data)
    yield from episodes_read


def _episode(arrays: Mapping[str, Any], suffix: str, episode: int) -> StoredPath:
    """Return one episode of a file.

    Raises:
        ValueError: an array has the wrong type or shape, or is not finite.
    """
    keys = {n: f"{n}_{suffix}" for n in (*REQUIRED, *OPTIONAL)}
    raw = {n: arrays[key] for n, key in keys.items() if n in REQUIRED or key in arrays}
    # Check the types before the conversion to float64, which may need eight times the memory of another type.
    if any(array.dtype.kind != "f" for array in raw.values()):
        raise ValueError(f"episode {episode} has no floating-point numbers")
    path = {name: array.astype(np.float64) for name, array in raw.items()}
    position = path["position"]
    if position.ndim != 2 or position.shape[1] != 3 or len(position) == 0:
        raise ValueError(f"position_{suffix} must have the shape (steps + 1, 3), got {position.shape}")
    shapes: dict[str, tuple[int, ...]] = {
        "time": (len(position),),
        "waypoint": (3,),
        "reference": position.shape,
        "dock_yaw": (1,),
        "yaw": (len(position),),
    }
    if "command" in path:
        shapes["command"] = (len(position) - 1, *path["command"].shape[1:2])
    if "outlines" in path:
        shapes["outlines"] = (len(path["outlines"]), 2, 3)
    if "others" in path:
        shapes["others"] = (len(position), *(min(n, MOST_VEHICLES - 1) for n in path["others"].shape[1:2]), 3)
    for name, array in path.items():
        if array.shape != shapes.get(name, array.shape):
            raise ValueError(f"{name}_{suffix} must have the shape {shapes[name]}, got {array.shape}")
    if not all(finite(values) for values in path.values()):
        raise ValueError(f"episode {episode} has numbers that are not finite")
    x, y, z = path["waypoint"].tolist()
    yaw = float(path["dock_yaw"][0]) if "dock_yaw" in path else None
    moving, solids = path.get("reference"), path.get("outlines")
    more = path.get("yaw"), path.get("command"), path.get("others")
    return StoredPath(episode, (x, y, z), position, path["time"], moving, yaw, solids, *more)

"""Read and check the records of a run: trajectories of a test, episodes and validations of the training."""

from __future__ import annotations

import csv
import io
import itertools
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from auvbench.analysis.archive import EPISODES, TRAIN
from auvbench.analysis.evaluations import Damage, check_digest, finite, named
from auvbench.analysis.records import Evaluation, RunRecord
from auvbench.runs import integrity
from auvbench.statistics.intervals import FloatArray
from auvbench.untrusted import archives, columns, reading, tables, typed_json

NAME = "trajectories.npz"
REQUIRED = ("waypoint", "position", "time")
OPTIONAL = ("reference", "dock_yaw", "outlines")


@dataclass(frozen=True, slots=True, eq=False)
class StoredPath:
    """Trajectory of a vehicle in one test episode."""

    episode: int
    waypoint: tuple[float, float, float]  # m; the goal, in tasks without waypoints
    position: FloatArray  # (T + 1, 3) m
    time: FloatArray  # (T + 1,) s
    reference: FloatArray | None = None  # (T + 1, 3) m, if the reference moves; missing in a published study
    dock_yaw: float | None = None  # rad; missing in a published study
    outlines: FloatArray | None = None  # (k, 2, 3) m, segments of a world; missing in a published study


def has_paths(evaluation: Evaluation | None) -> bool:
    """Return whether trajectories of a test are stored."""
    if evaluation is None:
        return False
    if evaluation.archive is not None:
        return evaluation.archive.has_paths
    return (evaluation.directory / NAME).is_file()


def paths(run: str, evaluation: Evaluation, condition: str, episodes: int) -> Iterator[StoredPath]:
    """Yield the stored trajectories of one condition, at most `episodes` of them.

    Raises:
        Damage: the file cannot be read, or has no trajectories; a pickle is never loaded.
    """
    if evaluation.archive is None:
        yield from _of_file(evaluation.directory / NAME, condition, episodes)
        return
    rows = evaluation.episodes
    rows = rows[rows["condition"] == condition].set_index("episode")
    goal = "waypoint" if "waypoint_x_m" in rows.columns else "goal"
    with named(EPISODES):
        waypoints = rows[[f"{goal}_{axis}_m" for axis in "xyz"]].to_numpy(dtype=np.float64)
    where = {int(episode): i for i, episode in enumerate(rows.index)}
    stored = evaluation.archive.paths(run, evaluation.protocol, condition)
    for episode, position, time in itertools.islice(stored, episodes):
        if episode not in where:
            raise Damage(f"trajectories of episode {episode}, which was not tested")
        x, y, z = waypoints[where[episode]].tolist()
        yield StoredPath(episode, (x, y, z), position, time)


def _of_file(file: Path, condition: str, episodes: int) -> Iterator[StoredPath]:
    with named(file.name):
        data = reading.content(file, reading.DATA)
        arrays = archives.paths(data, condition, episodes)
        named_so = re.compile(rf"position_{re.escape(condition)}_(\d+)")
        numbers = sorted(int(match[1]) for key in arrays if (match := named_so.fullmatch(key)))
        episodes_read = [
            _episode(arrays, f"{condition}_{episode}", episode) for episode in numbers[:episodes]
        ]
    # Checked last, because the other checks give more specific messages.
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
    # Checked before conversion to float64: a byte would become eight.
    if any(array.dtype.kind != "f" for array in raw.values()):
        raise ValueError(f"episode {episode} has no floating-point numbers")
    path = {name: array.astype(np.float64) for name, array in raw.items()}
    position = path["position"]
    if position.ndim != 2 or position.shape[1] != 3 or len(position) == 0:
        raise ValueError(f"position_{suffix} has shape {position.shape}, expected (steps + 1, 3)")
    shapes: dict[str, tuple[int, ...]] = {
        "time": (len(position),),
        "waypoint": (3,),
        "reference": position.shape,
        "dock_yaw": (1,),
    }
    if "outlines" in path:
        shapes["outlines"] = (len(path["outlines"]), 2, 3)
    for name, array in path.items():
        if array.shape != shapes.get(name, array.shape):
            raise ValueError(f"{name}_{suffix} has shape {array.shape}, expected {shapes[name]}")
    if not all(finite(values) for values in path.values()):
        raise ValueError(f"episode {episode} has numbers that are not finite")
    x, y, z = path["waypoint"].tolist()
    yaw = float(path["dock_yaw"][0]) if "dock_yaw" in path else None
    moving, solids = path.get("reference"), path.get("outlines")
    return StoredPath(episode, (x, y, z), position, path["time"], moving, yaw, solids)


TRAINING = "train/episodes.csv"


def has_training(run: RunRecord) -> bool:
    """Return whether the run has training episodes."""
    if run.archive is not None:
        return run.archive.has_training(run.id)
    return (run.directory / TRAINING).exists()


def training(run: RunRecord) -> pd.DataFrame | None:
    """Return the columns of train/episodes.csv that a report uses; None without that file (PID).

    A table without rows is valid: no episode ended during a short training.

    Raises:
        Damage: the file cannot be read, lacks a column, or has an impossible value.
    """
    if not has_training(run):
        return None
    if run.archive is not None:
        frame = run.archive.episodes(run.id, TRAIN)
        with named(TRAINING):
            return columns.checked(frame, columns.TRAINING)
    with named(TRAINING):
        data = reading.content(run.directory / TRAINING, reading.DATA)
        frame = columns.checked(tables.csv(data, columns.TRAINING), columns.TRAINING)
    check_digest(run.manifest, TRAINING, data)
    return frame


VALIDATION = "train/validation.csv"


def read_validation_curve(run: RunRecord) -> pd.DataFrame | None:
    """Return `step` and `success_rate` (0 to 1) of train/validation.csv with rising steps; None if it has no
    rows.

    Raises:
        Damage: the file cannot be read, or has an impossible value.
    """
    with named(VALIDATION):
        rows = validation_rows(run)
        frame = pd.DataFrame({n: [float(row[n]) for row in rows] for n in ("step", "success_rate")})
    rising, possible = frame["step"].is_monotonic_increasing, frame["success_rate"].between(0, 1).all()
    if not (rising and possible and finite(frame.to_numpy())):
        raise Damage(f"{VALIDATION} has rows that do not belong together, or impossible numbers")
    return frame if len(frame) else None


def validation_rows(run: RunRecord) -> list[dict[str, Any]]:
    """Return the rows of train/validation.csv; empty without that file.

    Raises:
        Damage: the file cannot be read.
    """
    with named(VALIDATION):
        if run.archive is not None:
            rows = run.archive.document(run.id, "validation") or []
            return typed_json.convert(rows, list[dict[str, Any]])
        path = run.directory / VALIDATION
        if not path.exists():
            return []
        return list(csv.DictReader(io.StringIO(reading.content(path).decode("utf-8"))))

"""Save the results of slow conditions during a test, so that an interrupted test does not compute them again.

The part of a condition is a folder next to the test's lock: `evaluations/.<protocol>/parts/<number of the
condition>`. The part is reused if run, model, protocol, scenarios, outcomes of the scenarios and versions of the code
have not changed since. All parts are removed when the test is complete.
"""

from __future__ import annotations

import csv
import io
import json
import shutil
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.config import schema
from auvbench.config.schema import step_limit
from auvbench.evaluation.protocol import ResolvedCondition, fingerprint_parts
from auvbench.evaluation.rollout import Rollout
from auvbench.record import columns
from auvbench.registry import TASKS
from auvbench.runs import integrity, provenance
from auvbench.runs.atomic_io import sha256
from auvbench.runs.directory import RunDirectory
from auvbench.runs.identity import SCHEMA_VERSION
from auvbench.untrusted import archives, reading

SLOW = 30.0
"""smallest computing time of a condition whose part is saved, s; a quicker condition is computed again"""
_PART, _ROWS, _PATHS = "part.json", "rows.csv", "trajectories.npz"


@dataclass(frozen=True, slots=True)
class Part:
    """Results of one condition for the files of a test."""

    summary: dict[str, Any]
    rows: list[list[Any]]
    """header, and one row per episode; in a saved part, all values are text"""
    arrays: Mapping[str, NDArray[Any]]


@dataclass(frozen=True, slots=True)
class _Content:
    """Content of part.json."""

    key: str
    condition: integrity.Condition
    files: dict[str, integrity.FileEntry]


def of(condition: ResolvedCondition, rollout: Rollout) -> Part:
    """Return the part of a condition from its rollout."""
    arrays = {
        f"{name}_{condition.name}_{episode}": array
        for episode, path in rollout.trajectories.items()
        for name, array in path.arrays(rollout.duration).items()
    }
    return Part(_summary(condition, rollout), _table(condition, rollout), arrays)


def _summary(condition: ResolvedCondition, rollout: Rollout) -> dict[str, Any]:
    records = rollout.records
    counts = Counter(record["outcome"] for record in records)
    n = len(records)
    rates = {f"{outcome}_rate": counts[outcome] / n for outcome in TASKS[condition.config.task.name].outcomes}
    means = {
        f"mean_{name}": float(np.mean([float(r[name]) for r in records]))
        for name in columns("episode")
        if name in records[0]
    }
    limit = step_limit(condition.config.task, condition.config.step.frequency)
    return {
        "name": condition.name,
        "frequency_hz": condition.config.step.frequency,
        "max_steps": limit,
        "episodes": n,
        **rates,
        "par1_steps": float(np.mean([r["steps"] if r["outcome"] == "success" else limit for r in records])),
        **means,
        **({"notes": rollout.notes} if rollout.notes else {}),
    }


def _table(condition: ResolvedCondition, rollout: Rollout) -> list[list[Any]]:
    frequency = condition.config.step.frequency
    names = schema.columns_of(condition.config)
    rows = ([condition.name, frequency, *(row.get(name, "") for name in names)] for row in rollout.records)
    return [["condition", "frequency_hz", *names], *rows]


def rows_of(parts: Sequence[Part]) -> bytes:
    """Return the content of episodes.csv.

    Conditions may have different columns, because their worlds, navigation and filters may differ. If a condition
    lacks a column, this column is empty in the condition's rows.
    """
    names = dict.fromkeys(name for part in parts for name in part.rows[0])
    text = io.StringIO()
    writer = csv.DictWriter(text, names, restval="", lineterminator="\n")
    writer.writeheader()
    for part in parts:
        header, *rows = part.rows
        writer.writerows(dict(zip(header, row, strict=True)) for row in rows)
    return text.getvalue().encode()


def arrays_of(parts: Sequence[Part]) -> bytes:
    """Return the content of trajectories.npz."""
    stream = io.BytesIO()
    np.savez_compressed(stream, **{name: array for part in parts for name, array in part.arrays.items()})  # type: ignore[arg-type]
    return stream.getvalue()


@dataclass(frozen=True, slots=True)
class SavedParts:
    """Saved parts of one test.

    Args:
        folder: folder of the parts.
        run: tested run.
        protocol: protocol of the test.
    """

    folder: Path
    run: RunDirectory
    protocol: schema.Protocol

    def read(self, number: int, condition: ResolvedCondition) -> Part | None:
        """Return the saved part of a condition; None if it is missing, damaged or from a different test."""
        place = self.folder / str(number)
        if not place.is_dir():
            return None
        try:
            holder = integrity.read(place / _PART, _Content)
            if holder["key"] != self._key(condition) or integrity.lacking(place, holder):
                return None
            text = reading.content(place / _ROWS, reading.DATA).decode("utf-8")
            arrays = archives.arrays(reading.content(place / _PATHS, reading.DATA))
        except (OSError, ValueError):
            return None  # damaged, or written by another version
        return Part(holder["condition"], list(csv.reader(io.StringIO(text))), arrays)

    def write(self, number: int, condition: ResolvedCondition, part: Part) -> None:
        """Save the part of a condition.

        Raises:
            TrainingError: the disk is full, read-only or failing.
        """
        holder = {
            "schema_version": SCHEMA_VERSION,
            "key": self._key(condition),
            "condition": part.summary,
        }
        files = {_ROWS: rows_of([part]), _PATHS: arrays_of([part])}
        integrity.replace_sealed(self.folder / str(number), _PART, holder, files)

    def forget(self) -> None:
        """Remove all parts."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def _key(self, condition: ResolvedCondition) -> str:
        """Return a digest of everything that determines the rows of a condition."""
        depends = {
            "run": self.run.id,
            "model": integrity.digests(self.run.manifest(), "model/"),
            "protocol": asdict(self.protocol),
            "condition": condition.name,
            "drawn": fingerprint_parts(self.protocol, [condition]),
            "versions": provenance.versions(),
            "git": provenance.git(),
        }
        return sha256(json.dumps(depends, sort_keys=True, default=str).encode())

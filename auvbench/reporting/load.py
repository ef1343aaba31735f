"""Reads run directories for a report, and names what keeps a run, or a part of it, out of the tables.

Nothing here stops at the first thing wrong: what can be read is returned, the rest comes back as `Problem`s.
Format of the directories: docs/architecture.md; of the CSV: docs/protocol.md.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

from auvbench.errors import ReportError
from auvbench.reporting.grouping import agents
from auvbench.reporting.model import Evaluation, Problem, RunRecord
from auvbench.reporting.processes import each
from auvbench.tasks.record import OUTCOMES

__all__ = ["CORE_COLUMNS", "SCHEMA_VERSION", "agents", "available_protocols", "load"]

SCHEMA_VERSION = 1
"""of manifest.json and summary.json: what this auvbench reads"""

CORE_COLUMNS = (
    "steps",
    "duration_s",
    "return",
    "final_distance_m",
    "deviation_mean_m",
    "deviation_std_m",
    "command_norm_mean_N",
    "command_norm_sum_N",
    "energy_J",
)
"""without these, finite in every row, an evaluation is not reported on; not all of a record's columns, so that an
evaluation stays readable when a later auvbench measures something more"""


_Read = tuple[RunRecord | None, list[Problem]]
"""a run, if it can be used, and what is wrong with it"""


class _Damage(Exception):
    """Why a file cannot be used; `kind` is that of the `Problem`."""

    def __init__(self, message: str, kind: str = "damaged") -> None:
        super().__init__(message)
        self.kind = kind


def load(
    paths: Iterable[str | Path], protocol: str | Sequence[str] = "test"
) -> tuple[list[RunRecord], list[Problem]]:
    """All runs under some paths, with their evaluations by the given protocols.

    Args:
        paths: run directories or folders above them.
        protocol: name, or names, of the protocols whose evaluations are read. A complete run that lacks the
            first of them is named as a problem; the others may be absent.

    Returns:
        the runs sorted by id, failed and unfinished ones included (without evaluations), and the problems.

    Raises:
        ReportError: a path does not exist, or there is not one readable run under all of them.
    """
    protocols = (protocol,) if isinstance(protocol, str) else tuple(protocol)
    problems: list[Problem] = []
    directories = list(_directories(paths, problems))
    runs = _without_duplicates(_collect(each(_read_run, directories), problems), problems)
    if not runs:
        details = f": {problems[0].where}: {problems[0].message}" if problems else ""
        raise ReportError(f"no run under {', '.join(map(str, paths))}{details}")
    return _collect(each(lambda run: _with_evaluations(run, protocols), runs), problems), problems


def _collect(read: Iterable[_Read], problems: list[Problem]) -> list[RunRecord]:
    """The runs there are; what was wrong is added to `problems`."""
    runs = []
    for run, found in read:
        problems += found
        if run is not None:
            runs.append(run)
    return runs


def available_protocols(runs: Iterable[RunRecord]) -> list[str]:
    """Names of the protocols by which at least one of the runs was evaluated."""
    return sorted({p.parent.name for run in runs for p in run.directory.glob("evaluations/*/summary.json")})


def _directories(paths: Iterable[str | Path], problems: list[Problem]) -> Iterator[Path]:
    seen: set[Path] = set()
    for path in map(Path, paths):
        if not path.exists():
            raise ReportError(f"no such folder: {path}")
        found = 0
        for folder, folders, files in os.walk(path):
            here = Path(folder)
            if "manifest.json" in files:
                folders.clear()  # nothing below a run is a run
                found += 1
                if (real := here.resolve()) not in seen:
                    seen.add(real)
                    yield here
            elif "config.yaml" in files and here != path:
                folders.clear()
                problems.append(Problem(str(here), "damaged", "config.yaml without a manifest.json"))
            else:
                folders[:] = sorted(f for f in folders if f != "report" and not f.startswith("."))
        if not found:
            problems.append(Problem(str(path), "missing", "no run here (no folder with a manifest.json)"))


def _read_run(directory: Path) -> _Read:
    try:
        return _run(directory), []
    except _Damage as damage:
        return None, [Problem(str(directory), damage.kind, str(damage))]


def _run(directory: Path) -> RunRecord:
    manifest = _json(directory / "manifest.json")
    if missing := {"id", "state", "seed"} - manifest.keys():
        raise _Damage(f"manifest.json is not that of a run (no {', '.join(sorted(missing))})", "foreign")
    if not isinstance(manifest["seed"], int):
        raise _Damage(f"manifest.json has the seed {manifest['seed']!r}, which is no integer")
    path = directory / "config.yaml"
    try:
        # The C loader is ten times faster than OmegaConf on a resolved configuration.
        config = yaml.load(path.read_bytes(), Loader=yaml.CSafeLoader)
    except OSError as error:
        raise _Damage("config.yaml is missing") from error
    except yaml.YAMLError as error:
        raise _Damage("config.yaml is not valid YAML") from error
    if not isinstance(config, dict):
        raise _Damage("config.yaml is empty")
    return RunRecord(
        id=str(manifest["id"]),
        directory=directory,
        state=str(manifest["state"]),
        seed=manifest["seed"],
        config=dict(_flat(config)),
        manifest=manifest,
    )


def _flat(config: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in config.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _json(path: Path) -> dict[str, Any]:
    """A JSON object of the schema version that is read here."""
    try:
        data = json.loads(path.read_bytes())
    except OSError as error:
        raise _Damage(f"{path.name} is missing") from error
    except ValueError as error:
        raise _Damage(f"{path.name} is not valid JSON") from error
    version = data.get("schema_version") if isinstance(data, dict) else None
    if version != SCHEMA_VERSION:
        raise _Damage(
            f"{path.name} has schema_version {version}, this auvbench reads {SCHEMA_VERSION}", "foreign"
        )
    return dict(data)


def _without_duplicates(runs: Sequence[RunRecord], problems: list[Problem]) -> list[RunRecord]:
    """One run per id: of copies, the complete one that ended last."""
    by_id: dict[str, list[RunRecord]] = {}
    for run in runs:
        by_id.setdefault(run.id, []).append(run)
    kept = []
    for _, copies in sorted(by_id.items()):
        copies.sort(
            key=lambda r: (r.state == "complete", str(r.manifest.get("ended") or ""), str(r.directory))
        )
        kept.append(copies[-1])
        for copy in copies[:-1]:
            message = f"a second run with this id, in {copy.directory}; {copies[-1].directory} is reported"
            problems.append(Problem(copy.id, "duplicate", message))
    return kept


def _with_evaluations(run: RunRecord, protocols: Sequence[str]) -> _Read:
    """The run with its evaluations read; a failed or unfinished one keeps none."""
    if run.state != "complete":
        return run, [_why_not(run)]
    evaluations = {}
    problems = []
    for name in protocols:
        directory = run.directory / "evaluations" / name
        if not directory.is_dir():
            if name == protocols[0]:
                hint = f"auvbench evaluate {run.directory} protocol={name}"
                problems.append(Problem(run.id, "missing", f"no evaluation by protocol {name}: {hint}"))
            continue
        try:
            evaluations[name] = _read_evaluation(directory)
        except _Damage as damage:
            problems.append(Problem(run.id, damage.kind, f"evaluation {name}: {damage}"))
    return replace(run, evaluations=evaluations), problems


def _why_not(run: RunRecord) -> Problem:
    manifest = run.manifest
    if run.state == "failed":
        error = manifest.get("error")
        error = error if isinstance(error, dict) else {}
        at = f" at step {error['step']:,}" if isinstance(error.get("step"), int) else ""
        return Problem(run.id, "failed", f"failed{at}: {error.get('message', 'no message')}")
    steps, total = manifest.get("steps") or 0, manifest.get("total_steps") or 0
    share = f" at {steps:,} of {total:,} steps" if total else ""
    return Problem(run.id, "unfinished", f"{run.state}{share}: type its command again to finish it")


def _read_evaluation(directory: Path) -> Evaluation:
    summary = _json(directory / "summary.json")
    if missing := {"fingerprint", "conditions"} - summary.keys():
        raise _Damage(f"summary.json has no {', '.join(sorted(missing))}")
    return Evaluation(
        protocol=directory.name,
        fingerprint=str(summary["fingerprint"]),
        summary=summary,
        episodes=_read_episodes(directory / "episodes.csv", summary),
        directory=directory,
    )


def _read_episodes(path: Path, summary: Mapping[str, Any]) -> pd.DataFrame:
    """episodes.csv, checked: all columns, all rows of the summary, no row cut short, all values finite."""
    try:
        frame = pd.read_csv(path, engine="c", low_memory=False)
        with path.open("rb") as file:
            file.seek(-1, os.SEEK_END)
            ends_with_newline = file.read() == b"\n"
    except FileNotFoundError as error:
        raise _Damage("episodes.csv is missing") from error
    except (OSError, ValueError) as error:  # pandas' parser and empty-data errors are ValueErrors
        raise _Damage(f"episodes.csv cannot be read ({str(error).strip()})") from error
    needed = ("condition", "episode", "outcome", *CORE_COLUMNS)
    if missing := [c for c in needed if c not in frame.columns]:
        raise _Damage(f"episodes.csv lacks the columns {', '.join(missing)}")
    try:
        expected = sum(int(condition["episodes"]) for condition in summary["conditions"])
    except (KeyError, TypeError, ValueError) as error:
        raise _Damage("summary.json does not say how many episodes each condition has") from error
    if len(frame) != expected:
        raise _Damage(f"episodes.csv has {len(frame)} rows, summary.json says {expected}: evaluate again")
    if not ends_with_newline or frame.iloc[-1:, -1].isna().any():
        raise _Damage(f"episodes.csv is cut short: the last of its {len(frame)} rows ends half way")
    if bad := {str(name) for name in frame["outcome"].to_numpy()} - set(OUTCOMES):
        raise _Damage(f"episodes.csv has the outcome {min(bad)!r}, none of {', '.join(OUTCOMES)}")
    _check_finite(frame)
    return frame


def _check_finite(frame: pd.DataFrame) -> None:
    core = frame[list(CORE_COLUMNS)].to_numpy()
    if core.dtype != object and np.isfinite(core).all():
        return
    for column in CORE_COLUMNS:
        values = frame[column].to_numpy()
        if values.dtype == object:
            values = pd.to_numeric(frame[column], errors="coerce").to_numpy(dtype=np.float64)
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            episode = frame["episode"].iloc[int(bad[0])]
            what = f"{column} is not a finite number in {bad.size} of {len(frame)} episodes"
            raise _Damage(f"episodes.csv: {what} (first: episode {episode})")

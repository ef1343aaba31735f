"""Write runs as a published study: Parquet files with everything that a report reads."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from auvbench.analysis import archive
from auvbench.analysis.damage import Damage
from auvbench.analysis.evaluations import disagreement
from auvbench.analysis.recorded import paths, training
from auvbench.analysis.records import Evaluation, RunRecord
from auvbench.errors import ReportError
from auvbench.registry import TASKS
from auvbench.runs import history, integrity
from auvbench.runs.atomic_io import write_atomic
from auvbench.untrusted import tables
from auvbench.untrusted.text import short

OUTPUT = "outputs"
"""value of `output` in a published configuration; the folder is not part of a run's identity"""
EPISODES_KEPT = 100
"""largest number of stored trajectories of a run under one condition"""
COMPACT = ("condition", "frequency_hz", "episode", "outcome", "steps")
"""first columns of a compact table; the columns of the tasks' primary measures and `ALSO_COMPACT` follow"""
ALSO_COMPACT = ("final_position_error_m", "energy_J")
DIGITS = 3
"""Significant digits of the measures in a compact table; the rounding errors of episodes mostly cancel in a mean"""


def write(
    runs: Sequence[RunRecord],
    folder: Path,
    protocols: Sequence[str],
    *,
    trajectories: bool,
    compact: bool = False,
) -> list[str]:
    """Write runs.parquet, episodes.parquet and, on request, trajectories.parquet into a folder.

    Args:
        runs: loaded runs, complete or failed.
        folder: folder of the study.
        protocols: protocols to write. Episodes of the first protocol get all columns in full precision; episodes of
            the other protocols get the compact table (`COMPACT`).
        trajectories: whether to write the stored trajectories of the first protocol.
        compact: if true, the first protocol's episodes also get only the compact table, and training episodes are left out.

    Returns:
        One message for each run whose validation or training episodes are damaged and therefore left out.

    Raises:
        OSError: a file cannot be read or written.
        ReportError: a run was changed after it was loaded.
    """
    problems: list[str] = []
    rows, episodes, tracks = [], [], []
    for run in sorted(runs, key=lambda run: run.id):
        summaries = {}
        for protocol in protocols:
            evaluation = run.evaluations.get(protocol)
            if evaluation is None:
                continue
            frame = evaluation.episodes
            if compact or protocol != protocols[0]:
                frame = _compacted(frame)
            summaries[protocol] = integrity.sealed({**evaluation.summary, integrity.FILES: {}})
            episodes.append(_labelled(frame, run.id, protocol))
            if trajectories and protocol == protocols[0]:
                tracks += _tracks(run, evaluation)
        trained, validation = None, []
        try:
            validation = run.source.validation()
            trained = None if compact else training(run)
        except Damage as damage:
            problems.append(f"{run.id}: {damage}")
        if trained is not None and len(trained):
            episodes.append(_labelled(trained, run.id, archive.TRAIN))
        rows.append(_row(run, summaries, validation))
    files = {archive.EPISODES: tables.parquet(_joined(episodes), {})}
    if tracks:
        files[archive.TRAJECTORIES] = tables.parquet(pd.concat(tracks, ignore_index=True), {})
    folder.mkdir(parents=True, exist_ok=True)
    for name, data in files.items():
        write_atomic(folder / name, data)
    if not tracks:
        (folder / archive.TRAJECTORIES).unlink(missing_ok=True)
    # runs.parquet is written last, because it contains the digests of the other files.
    table = pd.DataFrame(rows)
    write_atomic(folder / archive.RUNS, tables.parquet(table, archive.note(table, files)))
    return problems


def write_history(runs: Sequence[RunRecord], folder: Path) -> list[str]:
    """Write the histories of the runs' experiments into one file; return a text for each unreadable history.

    If all histories are empty, no file is written.

    Raises:
        OSError: the file cannot be written.
    """
    problems: list[str] = []
    histories = []
    for place in sorted({run.directory.absolute().parent for run in runs} | {folder.absolute()}):
        try:
            histories.append(history.read(place))
        except (OSError, ValueError) as error:
            problems.append(f"{place / history.FILE}: {short(error)}")
    if lines := history.merged(histories):
        write_atomic(folder / history.FILE, history.as_bytes(lines))
    return problems


def _row(
    run: RunRecord, summaries: Mapping[str, Any], validation: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    manifest, config = _manifest(run), _config(run)
    if wrong := disagreement(manifest, config):
        raise ReportError(f"{run.directory}: {wrong}: the run was changed during publishing; publish again")
    return {
        "run": run.id,
        "algo": str(run.config.get("algo.name")),
        "vehicle": str(run.config.get("vehicle.name")),
        "seed": run.seed,
        "state": run.state,
        "steps": int(manifest.get("steps") or 0),
        "config": _json(config),
        "manifest": _json(manifest),
        "evaluations": _json(summaries),
        "validation": _json(validation),
    }


def _json(value: Any) -> str:
    return json.dumps(value, separators=(",", ":"))


def _config(run: RunRecord) -> dict[str, Any]:
    """Return the nested configuration without the folders of this machine, which do not belong to a run's identity."""
    config = run.source.config()
    if run.source.published:
        return config
    published = {**config, "output": OUTPUT}
    algo = config.get("algo")
    if isinstance(algo, Mapping) and algo.get("path"):
        published["algo"] = {**algo, "path": Path(str(algo["path"])).name}
    return published


def _manifest(run: RunRecord) -> dict[str, Any]:
    """Return the manifest without the machine's name and folders."""
    published = dict(run.manifest)
    if run.source.published:
        return published
    if host := published.get("host"):
        published["host"] = {key: value for key, value in host.items() if key != "name"}
    try:
        words = shlex.split(published.get("command") or "")
    except ValueError:
        words = []
    published["command"] = shlex.join(word for word in words if not word.startswith("output="))
    if error := published[
        "error"
    ]:  # A traceback contains folders, and a message may contain the run's folder.
        message = str(error.get("message", "no message"))
        for place in (run.directory.absolute().parent, run.directory.parent):
            message = message.replace(f"{place}/", "")
        published["error"] = {"message": message, "step": error.get("step")}
    return integrity.sealed(published)


def _labelled(frame: pd.DataFrame, run: str, protocol: str) -> pd.DataFrame:
    table = frame.drop(columns=list(archive.FOLLOWING), errors="ignore")
    table.insert(0, "run", run)
    table.insert(1, "protocol", protocol)
    return table


def _compacted(frame: pd.DataFrame) -> pd.DataFrame:
    ranking = dict.fromkeys(TASKS[name].primary.removeprefix("mean_") for name in TASKS)
    table = frame.filter(items=[*COMPACT, *ranking, *ALSO_COMPACT]).copy()
    for name in table.select_dtypes("float").columns.drop("frequency_hz", errors="ignore"):
        table[name] = [float(f"{value:.{DIGITS}g}") for value in table[name]]
    return table


def _joined(frames: Sequence[pd.DataFrame]) -> pd.DataFrame:
    joined = pd.concat(frames, ignore_index=True)
    for name in joined.columns:
        if joined[name].dtype.kind == "f" and name in ("episode", "environment", "steps", "step"):
            joined[name] = joined[name].astype("Int64")
    return joined


def _tracks(run: RunRecord, evaluation: Evaluation) -> list[pd.DataFrame]:
    """Return the stored trajectories of an evaluation in whole milliseconds and millimetres.

    Raises:
        ReportError: the trajectories are damaged.
    """
    if not run.source.has_paths(evaluation.protocol):
        return []
    tracks = []
    for condition in dict.fromkeys(evaluation.episodes["condition"]):
        try:
            for path in paths(run, evaluation.protocol, condition, EPISODES_KEPT):
                x, y, z = np.rint(1e3 * path.position).astype(np.int32).T
                tracks.append(
                    pd.DataFrame(
                        {
                            "run": run.id,
                            "protocol": evaluation.protocol,
                            "condition": condition,
                            "episode": np.int32(path.episode),
                            "t_ms": np.rint(1e3 * path.time).astype(np.int32),
                            "x_mm": x,
                            "y_mm": y,
                            "z_mm": z,
                        }
                    )
                )
        except Damage as damage:
            raise ReportError(f"{run.directory}: {short(damage)}") from damage
    return tracks

"""Whether the files of a run agree: with the digests that vouch for them, with each other, and with the run's id.

Each function returns what is wrong, or an empty text.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from auvbench.record import OUTCOMES, measured
from auvbench.runs import identity, integrity
from auvbench.untrusted.text import short

TOLERANCE = 1e-6
"""relative; the summary's means are those of the very numbers in the rows, up to rounding"""


def of_run(manifest: Mapping[str, Any], config: Mapping[str, Any]) -> str:
    """Return how a manifest differs from the run that config.yaml describes."""
    if wrong := identity.mismatch(config, str(manifest["id"])):
        return f"config.yaml does not belong to the run {manifest['id']}: {wrong}"
    if manifest["seed"] != config["seed"]:
        return f"manifest.json has the seed {manifest['seed']}, config.yaml {config['seed']}"
    named, meant = manifest["algo"], config["algo"]["name"]
    if named != meant:
        return f"manifest.json has the algo {named}, config.yaml {meant}"
    return ""


def of_evaluation(manifest: Mapping[str, Any], summary: Mapping[str, Any], protocol: str) -> str:
    """Whether an evaluation is of this run, of its present model, and by this protocol."""
    if summary.get("run", manifest["id"]) != manifest["id"]:
        return f"it is of the run {summary['run']}"
    if summary.get("protocol", protocol) != protocol:
        return f"it is by the protocol {summary['protocol']}"
    tested, there = summary.get("model"), integrity.digests(manifest, "model/")
    if tested is not None and tested != there:
        return "another model was tested than the run has now: evaluate again"
    return ""


def of_file(holder: Mapping[str, Any], name: str, data: bytes) -> str:
    """Return how a file differs from what the manifest or summary records."""
    if integrity.FILES not in holder:  # digests are recorded when a run is complete
        return ""
    wrong = integrity.difference(holder, name, data)
    return f"{Path(name).name} {wrong}" if wrong else ""


def of_neighbour(file: Path, data: bytes) -> str:
    """As `of_file`, for a file of an evaluation and the summary next to it."""
    try:
        summary = integrity.read(file.parent / "summary.json", integrity.Summary)
    except (OSError, ValueError) as error:
        return f"summary.json next to it cannot be read ({short(error)})"
    return of_file(summary, file.name, data)


def of_rows(summary: Mapping[str, Any], frame: pd.DataFrame) -> str:
    """Whether rates, means and frequencies of a summary are those of the rows, condition by condition."""
    for condition, mine, found in _found(summary, frame):
        for key, value in found.items():
            if key in condition and not _same(condition[key], value):
                return (
                    f"its rows give {key} {value:.6g} of condition {condition['name']!r}, "
                    f"summary.json says {condition[key]}: evaluate again"
                )
        said = condition.get("frequency_hz")
        if said is not None and not _all_at(frame, mine, said):
            return f"its rows of condition {condition['name']!r} are not all of the {said} Hz of summary.json"
    return ""


def _found(
    summary: Mapping[str, Any], frame: pd.DataFrame
) -> Iterator[tuple[Mapping[str, Any], NDArray[np.bool_], dict[str, float]]]:
    """Each condition of a summary, which rows are its own, and their rates and means."""
    # Column by column: to bring whole numbers and others into one table takes longer than all the rest.
    columns = {name: frame[name].to_numpy(dtype=np.float64) for name in measured() if name in frame.columns}
    outcomes = frame["outcome"].to_numpy(dtype=object)
    alone = len(summary["conditions"]) == 1
    names = None if alone else frame["condition"].to_numpy(dtype=object)
    for condition in summary["conditions"]:
        mine = np.ones(len(frame), dtype=np.bool_) if names is None else names == condition["name"]
        found = {f"{outcome}_rate": float(np.mean(outcomes[mine] == outcome)) for outcome in OUTCOMES}
        found |= {f"mean_{name}": float(values[mine].mean()) for name, values in columns.items()}
        yield condition, mine, found


def _same(said: Any, found: float) -> bool:
    if type(said) not in (int, float):
        return False
    return bool(abs(said - found) <= TOLERANCE * max(1.0, abs(found)))


def _all_at(frame: pd.DataFrame, mine: NDArray[np.bool_], frequency: Any) -> bool:
    if "frequency_hz" not in frame.columns:
        return True
    values = frame["frequency_hz"].to_numpy()[mine]
    return values.dtype.kind in "if" and type(frequency) in (int, float) and bool((values == frequency).all())

"""Read and check one evaluation of a run: no row of a damaged one enters a table.

The files of a run must agree with their recorded digests, with each other, and with the run's id.
"""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
import pandas as pd

from auvbench import metrics
from auvbench.analysis.records import Evaluation, RunRecord
from auvbench.runs import identity, integrity
from auvbench.untrusted import archives, columns, path_safety, reading, tables
from auvbench.untrusted.columns import LARGEST
from auvbench.untrusted.text import LONGEST, plain, short


class Damage(Exception):
    """A file cannot be used; `kind` is the kind of `Problem`."""

    def __init__(self, message: str, kind: str = "damaged") -> None:
        super().__init__(message)
        self.kind = kind


def is_name(value: Any) -> bool:
    """Return whether a text is a valid name in tables and figures: one line, limited length, every character
    visible.
    """
    return isinstance(value, str) and 0 < len(value) <= LONGEST and plain(value) == value


def finite(table: np.ndarray[Any, Any]) -> bool:
    """Return whether all values are finite numbers of a plausible size."""
    # A text anywhere gives the table the type object; NaN compares as False.
    return table.dtype.kind in "if" and bool((np.abs(table) <= LARGEST).all())


@contextmanager
def named(file: str) -> Iterator[None]:
    """Turn an error in reading a file into a Damage that names the file."""
    try:
        yield
    except FileNotFoundError as error:
        raise Damage(f"{file} is missing") from error
    except integrity.VersionError as error:
        raise Damage(f"{file} has {error}", "foreign") from error
    except OSError as error:
        raise Damage(f"{file}: {error.strerror or short(error)}") from error
    except (*archives.FAULTS, TypeError, RecursionError, csv.Error) as error:
        raise Damage(f"{file}: {short(error) or type(error).__name__}") from error


def check_digest(holder: Mapping[str, Any], name: str, data: bytes) -> None:
    """Compare a file with its record in the manifest or summary.

    Raises:
        Damage: the file differs.
    """
    # Digests are recorded when a run is complete.
    if integrity.FILES in holder and (wrong := integrity.difference(holder, name, data)):
        raise Damage(f"{name} {wrong}")


def disagreement(manifest: Mapping[str, Any], config: Mapping[str, Any]) -> str:
    """Return how a manifest differs from the run that config.yaml describes; '' if they agree."""
    if wrong := identity.mismatch(config, str(manifest["id"])):
        return f"config.yaml does not belong to the run {manifest['id']}: {wrong}"
    for key, configured in (("seed", config["seed"]), ("algo", config["algo"]["name"])):
        if manifest[key] != configured:
            return f"manifest.json has the {key} {manifest[key]}, config.yaml {configured}"
    return ""


def protocols_of(run: RunRecord) -> list[str]:
    """Return the names of the protocols by which a run was tested."""
    if run.archive is not None:
        return sorted(run.archive.summaries(run.id))
    return sorted(path.parent.name for path in run.directory.glob("evaluations/*/summary.json"))


def evaluation_of(run: RunRecord, protocol: str) -> Evaluation:
    """Read the evaluation of a run by a protocol.

    Raises:
        Damage: the evaluation cannot be used, was changed, or its files disagree.
    """
    schema = columns.of_test()
    if (study := run.archive) is not None:
        with named(f"the summary of {short(protocol, 40)}"):
            summary = integrity.checked(study.summaries(run.id)[protocol], integrity.Summary)
        with named(f"episodes of {short(run.id, 60)} by {short(protocol, 40)}"):
            frame = columns.checked(study.episodes(run.id, protocol), schema)
        _check_episodes(frame, summary)
        return Evaluation(protocol, summary["fingerprint"], summary, frame, study.folder, study)
    directory = path_safety.child(run.directory / "evaluations", protocol)
    with named("summary.json"):
        summary = integrity.read(directory / "summary.json", integrity.Summary)
    with named("episodes.csv"):
        data = reading.content(directory / "episodes.csv", reading.DATA)
        # A condition may be named 1.30.
        frame = tables.csv(data, schema, words=("condition",))
        if not data.endswith(b"\n") or _is_partial(frame):
            raise Damage(f"episodes.csv is cut short: the last of its {len(frame)} rows is incomplete")
        frame = columns.checked(frame, schema)
    _check_episodes(frame, summary)
    check_digest(summary, "episodes.csv", data)
    return Evaluation(protocol, summary["fingerprint"], summary, frame, directory)


def check_belongs(manifest: Mapping[str, Any], evaluation: Evaluation) -> None:
    """Check that an evaluation belongs to this run and its present model, and to the protocol of its folder.

    Raises:
        Damage: it does not.
    """
    summary, wrong = evaluation.summary, ""
    if summary["run"] != manifest["id"]:
        wrong = f"it is of the run {summary['run']}"
    elif summary["protocol"] != evaluation.protocol:
        wrong = f"it is by the protocol {summary['protocol']}"
    elif summary["model"] != integrity.digests(manifest, "model/"):
        wrong = "the run's model has changed since the test: evaluate again"
    if wrong:
        raise Damage(wrong, "foreign")


def _is_partial(frame: pd.DataFrame) -> bool:
    """Return whether the last row lacks the last column, unless this is a column that all rows of its condition may lack."""
    last = str(frame.columns[-1])
    if not len(frame) or not frame[last].isna().iloc[-1]:
        return False
    conditional = any(m.name == last and m.conditional for m in metrics.registered())
    in_condition = frame["condition"] == frame["condition"].iloc[-1]
    return not conditional or bool(frame.loc[in_condition, last].notna().any())


def _check_episodes(frame: pd.DataFrame, summary: Mapping[str, Any]) -> None:
    """Raise Damage unless each row that the summary counts is there exactly once."""
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

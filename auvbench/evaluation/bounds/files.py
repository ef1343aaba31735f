"""The limits of a protocol's scenarios as files, in the package and beside runs.

    <folder>/<protocol>-<vehicle>/limits.csv     a row per condition and episode
                                 /commands.npz   the commands that arrive in `steps`, one after the other
                                 /summary.json   fingerprint, versions, digests of the two

The commands are what makes a limit checkable: `tried` plays them once more.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import metadata, resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.errors import RunError
from auvbench.evaluation.bounds.trial import Commands, Scenario
from auvbench.runs import integrity
from auvbench.runs.atomic_io import as_json, replace_folder, storage
from auvbench.untrusted import archives, reading, tables, typed_json
from auvbench.untrusted.text import short
from auvbench.untrusted.typed_json import Name

SCHEMA_VERSION = 1
COLUMNS = (
    "condition",
    "frequency_hz",
    "episode",
    "steps",
    "time_s",
    "least_steps",
    "least_s",
    "start",
    "waypoint_x_m",
    "waypoint_y_m",
    "waypoint_z_m",
    "start_yaw_rad",
)
PLACES = ("waypoint_x_m", "waypoint_y_m", "waypoint_z_m", "start_yaw_rad")
FOLDER = "bounds"
"""beside the experiments in the folder of results, and in this package"""

Integers = NDArray[np.int64]
Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class ConditionLimits:
    """The limits under one condition, in the order of the episodes."""

    name: str
    frequency: float
    episodes: Integers
    """(n,)"""
    steps: Integers
    """(n,) fewest steps found: the true optimum needs as many or fewer"""
    least: Integers
    """(n,) steps below which it is proven that none arrives"""
    places: Floats
    """(n, 4) waypoint in m and yaw in rad: columns PLACES"""
    start: tuple[str, ...]
    """(n,) what the search began from"""
    commands: tuple[Commands, ...] = field(default=(), repr=False)
    """(n) arrays (steps, n_u); empty where they were not read"""
    least_seconds: Floats = field(default_factory=lambda: np.zeros(0))
    """(n,) s, the proven bound before it is rounded up to steps"""


@dataclass(frozen=True, slots=True, eq=False)
class Limits:
    """Those of one protocol and vehicle."""

    protocol: str
    vehicle: str
    fingerprint: str
    parts: Mapping[str, str]
    """scenarios and outcomes, as in an evaluation's summary"""
    conditions: tuple[ConditionLimits, ...]
    left_out: tuple[str, ...] = ()
    """conditions that have no limit, and why, a line each"""
    search: Mapping[str, Any] = field(default_factory=dict)
    """how it was searched"""

    def condition(self, name: str) -> ConditionLimits | None:
        return next((c for c in self.conditions if c.name == name), None)


@dataclass(frozen=True, slots=True)
class Summary:
    """summary.json of a folder of limits."""

    protocol: Name
    vehicle: Name
    fingerprint: Name
    fingerprint_parts: dict[str, str]
    left_out: list[str]
    search: dict[str, Any]
    files: dict[str, integrity.FileEntry]


def shipped() -> Path:
    """Where the package keeps those that come with it."""
    return Path(str(resources.files("auvbench.evaluation.bounds"))) / "shipped"


def folder_of(root: Path, protocol: str, vehicle: str) -> Path:
    return root / f"{protocol}-{vehicle}"


def write(folder: Path, limits: Limits) -> None:
    """Writes the three files.

    Raises:
        TrainingError: the disk is full, read-only or failing.
    """
    files = {"limits.csv": _csv(limits), "commands.npz": _npz(limits)}
    summary = {
        "schema_version": SCHEMA_VERSION,
        "protocol": limits.protocol,
        "vehicle": limits.vehicle,
        "fingerprint": limits.fingerprint,
        "fingerprint_parts": dict(limits.parts),
        "conditions": [{"name": c.name, "episodes": len(c.episodes)} for c in limits.conditions],
        "left_out": list(limits.left_out),
        "search": dict(limits.search),
        "versions": {name: metadata.version(name) for name in ("auvbench", "casadi", "numpy")},
        integrity.FILES: {name: integrity.entry(data) for name, data in files.items()},
    }
    files["summary.json"] = as_json(integrity.sealed(summary))
    with storage(f"cannot write {folder}"):
        replace_folder(folder, files)


def read(folder: Path, *, commands: bool = False) -> Limits | None:
    """What lies in a folder, checked against its digests; None where nothing does.

    Args:
        folder: of one protocol and vehicle.
        commands: read them too.

    Raises:
        RunError: a file is damaged, missing or not of the version that is read here.
    """
    try:
        summary = integrity.read_sealed(folder / "summary.json", SCHEMA_VERSION)
        about = typed_json.convert(summary, Summary)
    except (FileNotFoundError, NotADirectoryError):
        return None
    except (OSError, ValueError) as error:
        raise RunError(f"{folder}/summary.json: {short(error)}") from error
    names = ("limits.csv", "commands.npz") if commands else ("limits.csv",)
    data = {name: _checked(folder / name, summary) for name in names}
    try:
        return _limits(about, data["limits.csv"], data.get("commands.npz"))
    except (KeyError, TypeError, ValueError) as error:
        raise RunError(f"{folder}: the limits cannot be read ({short(error)})") from error


def _checked(path: Path, summary: Mapping[str, Any]) -> bytes:
    try:
        data = reading.content(path)
    except (OSError, ValueError) as error:
        raise RunError(f"{path} cannot be read ({getattr(error, 'strerror', None) or error})") from error
    if wrong := integrity.difference(summary, path.name, data):
        raise RunError(f"{path}: {wrong}")
    return data


def _limits(summary: Summary, text: bytes, packed: bytes | None) -> Limits:
    frame = tables.csv(text, words=("condition",))
    if missing := [name for name in COLUMNS if name not in frame.columns]:
        raise ValueError(f"limits.csv lacks {', '.join(missing)}")
    arrays = {}
    if packed is not None:
        with archives.opened(packed) as archive:
            arrays = {name: np.asarray(archive[name]) for name in archive.files}
    found = []
    for number, name in enumerate(dict.fromkeys(frame["condition"])):
        rows = frame[frame["condition"] == name]
        steps = rows["steps"].to_numpy(dtype=np.int64)
        least = rows["least_steps"].to_numpy(dtype=np.int64)
        if (steps < 1).any() or (least < 1).any() or (least > steps).any():
            raise ValueError(f"condition {name} has a limit that is none")
        commands = arrays.get(f"condition_{number}")
        if commands is not None and (commands.dtype != np.int8 or len(commands) != steps.sum()):
            raise ValueError("commands.npz is not that of limits.csv")
        found.append(
            ConditionLimits(
                name=name,
                frequency=float(rows["frequency_hz"].iloc[0]),
                episodes=rows["episode"].to_numpy(dtype=np.int64),
                steps=steps,
                least=least,
                places=rows[list(PLACES)].to_numpy(dtype=np.float64),
                start=tuple(rows["start"].astype(str)),
                commands=() if commands is None else tuple(np.split(commands, np.cumsum(steps)[:-1])),
                least_seconds=rows["least_s"].to_numpy(dtype=np.float64),
            )
        )
    return Limits(
        summary.protocol,
        summary.vehicle,
        summary.fingerprint,
        summary.fingerprint_parts,
        tuple(found),
        tuple(summary.left_out),
        summary.search,
    )


def _csv(limits: Limits) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for c in limits.conditions:
        for i, episode in enumerate(c.episodes.tolist()):
            steps, least = int(c.steps[i]), int(c.least[i])
            writer.writerow(
                (
                    c.name,
                    c.frequency,
                    episode,
                    steps,
                    steps / c.frequency,
                    least,
                    round(float(c.least_seconds[i]), 6),
                    c.start[i],
                    *c.places[i].tolist(),
                )
            )
    return text.getvalue().encode()


def _npz(limits: Limits) -> bytes:
    stream = io.BytesIO()
    arrays = {f"condition_{i}": np.concatenate(c.commands) for i, c in enumerate(limits.conditions)}
    np.savez_compressed(stream, **arrays)  # type: ignore[arg-type]
    return stream.getvalue()


def known_commands(
    folders: Iterable[Path], vehicle: str, frequency: float, scenarios: Sequence[Scenario]
) -> dict[int, tuple[str, Commands]]:
    """By place in `scenarios`, commands that other protocols' limits hold for the same start and waypoint.

    They are only worth something after they have been tried; folders that cannot be read have none.
    """
    by_place: dict[tuple[float, ...], tuple[str, Commands]] = {}
    for folder in folders:
        try:
            limits = read(folder, commands=True)
        except RunError:
            continue
        if limits is None or limits.vehicle != vehicle:
            continue
        for condition in limits.conditions:
            if condition.frequency != frequency:
                continue
            for place, start, commands in zip(
                condition.places, condition.start, condition.commands, strict=True
            ):
                key = tuple(np.round(place, 6).tolist())
                if key not in by_place or len(commands) < len(by_place[key][1]):
                    by_place[key] = (start, commands)
    keys = [tuple(np.round([*s.waypoint, s.yaw], 6).tolist()) for s in scenarios]
    return {i: by_place[key] for i, key in enumerate(keys) if key in by_place}


def find(
    protocol: str, vehicle: str, fingerprint: str, roots: Sequence[Path]
) -> tuple[Limits | None, list[str]]:
    """The limits of these very scenarios, from the first folder of limits that has them, else from the package.

    Args:
        protocol: its name.
        vehicle: its name.
        fingerprint: of the scenarios and their physics; limits of another are never used.
        roots: folders of limits that are looked at before the package's.

    Returns:
        the limits or None, and a line for each folder that could not be used.
    """
    said = []
    for root in dict.fromkeys((*roots, shipped())):
        folder = folder_of(root, protocol, vehicle)
        try:
            limits = read(folder)
        except RunError as error:
            said.append(str(error))
            continue
        if limits is None:
            continue
        if limits.fingerprint == fingerprint and (limits.protocol, limits.vehicle) == (protocol, vehicle):
            return limits, said
        said.append(f"{folder}: of other scenarios ({short(limits.fingerprint, 20)}, not {fingerprint})")
    return None, said


def is_name(text: str) -> bool:
    """Whether a protocol or vehicle of this name can name a folder."""
    return bool(text) and Path(text).name == text and not text.startswith(".")

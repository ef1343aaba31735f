"""Read a sealed protocol: a JSON file of conditions that were unknown when the agents of a study were chosen.

The conditions change the vehicle and the water of each run's test. Conditions that this version cannot simulate
are listed, not skipped silently. docs/sealed.md describes the keys.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any

from auvbench.config import folders, schema
from auvbench.config.validate import evaluate_protocol
from auvbench.errors import ConfigError, VehicleError, closest
from auvbench.registry import TASKS
from auvbench.untrusted import reading, typed_json
from auvbench.untrusted.path_safety import child, is_plain
from auvbench.untrusted.text import short
from auvbench.untrusted.typed_json import Name, Range
from auvbench.vehicles import reader, sheet
from auvbench.vehicles.changes import SCALES, Changes, changed

SUFFIX = ".json"
FREQUENCY, BATCH = 10.0, 500
OVERRIDES = ("task=same", "noise=thesis", "disturbance=none")
"""Overrides of every sealed protocol; the overrides of a condition are applied afterwards"""
NOT_YET = {
    "heading_bias_deg": "a heading bias whose sign is drawn",
    "depth_offset_m": "a depth offset whose sign is drawn",
    "dvl_lost_share": "a DVL that loses the bottom",
    "dvl_burst_s": "a DVL that loses the bottom",
}
"""Keys that this version cannot simulate, with their descriptions"""
DEPTHS = ("task.station", "task.dock", "task.start", "task.centre")
Factor = Annotated[float, Range(0.01, 100.0)]
Point = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Entry:
    """Condition in the file of a sealed protocol."""

    name: Name
    vehicle: Name | None = None
    scale: dict[str, Factor] = field(default_factory=dict)
    net_buoyancy_n: Annotated[float, Range(-1e6, 1e6)] | None = None
    payload_kg: Annotated[float, Range(0.0, 1e4)] | None = None
    payload_at_m: Point = (0.0, 0.0, 0.0)
    thrust_scale: Factor | None = None
    thruster_lag_s: Annotated[float, Range(0.0, 10.0)] | None = None
    weak_thrusters: list[Annotated[int, Range(1, 64)]] = field(default_factory=list)
    weak_share: list[Annotated[float, Range(0.001, 1.0)]] = field(default_factory=list)
    current_m_per_s: Annotated[float, Range(0.0, 10.0)] | None = None
    sea_state: Annotated[int, Range(2, 4)] | None = None
    depth_m: Annotated[float, Range(0.0, 1e4)] | None = None
    heading_bias_deg: float | None = None
    depth_offset_m: float | None = None
    delay_s: Annotated[float, Range(0.0, 10.0)] | None = None
    dvl_lost_share: float | None = None
    dvl_burst_s: float | None = None


@dataclass(frozen=True, slots=True)
class Content:
    """Content of the file of a sealed protocol."""

    name: Name
    scenario_seed: Annotated[int, Range(0, (1 << 32) - 1)]
    episodes: Annotated[int, Range(1, 1_000_000)]
    tasks: list[Name]
    conditions: list[Entry]
    nonce: str = ""


@dataclass(kw_only=True)
class Condition(schema.Condition):
    """Condition that may change the vehicle."""

    sheet: dict[str, Any] | None = None
    """Content of the vehicle sheet that replaces the run's vehicle sheet; None to keep the run's vehicle sheet"""
    changes: Changes = field(default_factory=Changes)

    def vehicle(self, own: Mapping[str, Any]) -> dict[str, Any]:
        """Return the vehicle sheet of the test for a run with the sheet `own`.

        Raises:
            VehicleError: the change does not fit the vehicle.
        """
        return changed(own if self.sheet is None else self.sheet, self.changes)


@dataclass(kw_only=True)
class Protocol(schema.Protocol):
    """Sealed protocol."""

    tasks: list[str]
    sha256: dict[str, str]
    """Digests of the file and of its sheets, by file name"""
    not_tested: list[str]
    """One line for each condition or task that this version cannot simulate, with the reason"""

    def refuse_task(self, task: str) -> None:
        """Raise ConfigError unless the protocol tests the task."""
        if task not in self.tasks:
            raise ConfigError(
                f"protocol {self.name} tests only the tasks {', '.join(self.tasks)}, but the run has task {task}"
            )


def read(path: Path) -> Protocol:
    """Return the protocol in a JSON file.

    Raises:
        ConfigError: the file cannot be read, or an entry is unknown or wrong; the message names the entry.
        VehicleError: a sheet is wrong.
    """
    try:
        data = reading.content(path)
        document = reading.json_value(data)
        _check_keys(document)
        content = typed_json.convert(document, Content)
    except FileNotFoundError:
        raise ConfigError(f"protocol={path}: no such file") from None
    except (OSError, ValueError) as error:
        raise ConfigError(f"protocol={path}: {getattr(error, 'strerror', None) or short(error)}") from error
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]*", content.name) or not is_plain(content.name):
        raise ConfigError(
            f"protocol={path}: name must be letters, digits, dots, dashes, underscores, got {short(content.name, 60)}"
        )
    if content.name in folders.options("protocol"):
        raise ConfigError(
            f"protocol={path}: name {content.name} belongs to another protocol; choose another name"
        )
    digests = {path.name: hashlib.sha256(data).hexdigest()}
    missing = [f"task {name}: unknown to this version" for name in content.tasks if name not in TASKS]
    conditions = []
    for entry in content.conditions:
        if keys := [key for key in NOT_YET if getattr(entry, key) is not None]:
            what = ", ".join(dict.fromkeys(NOT_YET[key] for key in keys))
            missing.append(
                f"condition {short(entry.name, 60)}: this version cannot simulate {what} ({', '.join(keys)})"
            )
            continue
        try:
            conditions.append(_condition(entry, path, digests))
        except ValueError as error:
            raise ConfigError(f"protocol={path}: condition {short(entry.name, 60)}: {error}") from error
    protocol = Protocol(
        name=content.name,
        scenarios="test",
        episodes=content.episodes,
        seed=content.scenario_seed,
        frequency=FREQUENCY,
        batch=BATCH,
        trajectories=0,
        overrides=list(OVERRIDES),
        conditions=list(conditions),
        tasks=[name for name in content.tasks if name in TASKS],
        sha256=digests,
        not_tested=missing,
    )
    evaluate_protocol(protocol)
    return protocol


def _check_keys(document: Any) -> None:
    """Raise ValueError for an unknown key of the file."""
    if not isinstance(document, dict):
        raise ValueError("it is not a JSON object")
    _refuse(document, Content, "")
    for at, entry in enumerate(entries if isinstance(entries := document.get("conditions"), list) else []):
        if isinstance(entry, dict):
            _refuse(entry, Entry, f"conditions[{at}].")
            scale = entry.get("scale")
            for name in scale if isinstance(scale, dict) else {}:
                if name not in SCALES:
                    raise ValueError(
                        f"conditions[{at}].scale.{short(name, 40)}: unknown key; {closest(name, SCALES)}"
                    )


def _refuse(entries: Mapping[str, Any], kind: type, where: str) -> None:
    names = [f.name for f in fields(kind)]
    for key in entries:
        if key not in names:
            raise ValueError(f"{where}{short(key, 40)}: unknown key; {closest(key, names)}")


def _condition(entry: Entry, path: Path, digests: dict[str, str]) -> Condition:
    """Return a condition, and add the digest of its sheet to `digests`.

    Raises:
        ValueError: values contradict each other, or the sheet is not a file next to the protocol.
    """
    if len(entry.weak_thrusters) != len(entry.weak_share) or len(set(entry.weak_thrusters)) < len(
        entry.weak_thrusters
    ):
        raise ValueError(
            "weak_thrusters and weak_share must have the same length, and weak_thrusters no number twice"
        )
    if len(entry.payload_at_m) != 3:
        raise ValueError("payload_at_m must be three numbers")
    document = None
    if entry.vehicle is not None:
        file = child(path.parent, entry.vehicle)
        document = _sheet(file, digests)
    thrust = entry.scale.get("thrust", 1.0) * (1.0 if entry.thrust_scale is None else entry.thrust_scale)
    scale = {name: factor for name, factor in entry.scale.items() if name != "thrust"}
    return Condition(
        name=re.sub(r"\s+", "-", entry.name.strip()),
        overrides=_overrides(entry),
        sheet=document,
        changes=Changes(
            scale if thrust == 1.0 else {**scale, "thrust": thrust},
            entry.net_buoyancy_n,
            entry.payload_kg or 0.0,
            entry.payload_at_m,
            entry.thruster_lag_s,
            dict(zip(entry.weak_thrusters, entry.weak_share, strict=True)),
        ),
    )


def _sheet(file: Path, digests: dict[str, str]) -> dict[str, Any]:
    """Return the content of a sheet merged with its parent sheets, and add the digest of the sheet's file to `digests`."""
    if file.suffix not in (".yaml", ".yml"):
        raise ValueError(f"vehicle must be a YAML file next to the protocol, got {short(file.name, 60)}")
    try:
        digests[file.name] = hashlib.sha256(reading.content(file)).hexdigest()
    except FileNotFoundError:
        raise ValueError(f"{file}: no such file; put the sheet next to the protocol") from None
    except OSError as error:
        raise VehicleError(f"{file}: {error.strerror}") from error
    document = reader.read(file)
    sheet.load(document.data)
    return document.data


def _overrides(entry: Entry) -> list[str]:
    """Return the entry's changes of water, depth and sensor readings as overrides of a configuration."""
    overrides = []
    if entry.sea_state is not None:
        overrides.append(f"disturbance=sea_state_{entry.sea_state}")
    if entry.current_m_per_s is not None:
        overrides.append(f"disturbance.current.speed={entry.current_m_per_s!r}")
    if entry.delay_s is not None:
        overrides.append(f"disturbance.delay.observation={entry.delay_s!r}")
    if entry.depth_m is not None:
        overrides += [f"{key}=[0,0,{-entry.depth_m!r}]" for key in DEPTHS]
    return overrides

"""Replay an episode of a test with its trajectory, or read a mission that a pilot recorded."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.config import schema
from auvbench.config.compose import compose
from auvbench.config.validate import train_config
from auvbench.errors import RunError, UserError, closest
from auvbench.evaluation.evaluate import make_agent, refuse_incomplete
from auvbench.evaluation.protocol import resolve_conditions
from auvbench.evaluation.rollout import one_episode
from auvbench.evaluation.signals import Recorder, Signals
from auvbench.pilot.mission import CONDITION, FORMAT, SCHEMA_VERSION
from auvbench.record import Record
from auvbench.runs.directory import RunDirectory
from auvbench.untrusted import archives, columns, reading, tables

Floats = NDArray[np.float32]

ARRAYS = ("time", "position", "yaw", "command", "waypoint")


@dataclass(frozen=True, slots=True, eq=False)
class Replay:
    """Episode of T steps with its record and trajectory."""

    run: str
    protocol: str
    condition: str
    config: schema.TrainConfig
    actuators: tuple[str, ...]
    record: Record
    time: Floats  # (T + 1,) s
    position: Floats  # (T + 1, 3) m
    yaw: Floats  # (T + 1,) rad
    command: Floats  # (T, n_u) N
    waypoint: Floats  # (3,) m, goal; in tasks with a moving reference, see `reference`
    reference: Floats | None = None  # (T + 1, 3) m, if the reference moves
    dock_yaw: Floats | None = None  # (1,) rad, heading in which a dock is entered
    outlines: Floats | None = None  # (k, 2, 3) m, segments that show the solids of a world
    others: Floats | None = None  # (T + 1, V - 1, 3) m, the other vehicles of a team
    signals: Signals | None = None  # only for an episode of a test

    @property
    def distance(self) -> Floats:
        """Return the distance (T + 1,) in m to the moving reference, or to the waypoint if the reference does not move."""
        to = self.waypoint if self.reference is None else self.reference
        return np.asarray(np.linalg.norm(self.position - to, axis=1), dtype=np.float32)


def replay(run: RunDirectory, protocol: schema.Protocol, condition: str, episode: int) -> Replay:
    """Run one episode of a protocol with a fresh agent; its record equals the record of the test.

    Raises:
        RunError: the run is incomplete.
        UserError: the protocol has no such condition or episode.
    """
    refuse_incomplete(run)
    if not 0 <= episode < protocol.episodes:
        raise UserError(
            f"--episode {episode}: protocol {protocol.name} has episodes 0 to {protocol.episodes - 1}"
        )
    configs = {c.name: c.config for c in resolve_conditions(protocol, run.check())}
    if condition not in configs:
        raise UserError(
            f"--condition {condition}: not in protocol {protocol.name}; {closest(condition, configs)}"
        )
    config = configs[condition]
    recorder = Recorder()
    agent = make_agent(run, config.step.frequency)
    result = one_episode(config, agent, protocol, episode, watch=recorder)
    return Replay(
        run=run.id,
        protocol=protocol.name,
        condition=condition,
        config=config,
        actuators=result.actuators,
        record=result.records[0],
        signals=recorder.signals(result.duration),
        **result.trajectories[episode].arrays(result.duration),
    )


def is_mission(folder: Path) -> bool:
    """Return whether a folder contains missions."""
    return (folder / "mission.json").is_file()


def read_mission(folder: Path, number: int) -> Replay:
    """Return mission `number` of a folder.

    Raises:
        RunError: the mission's files are damaged, or have a different version.
        UserError: the folder has no such mission.
    """
    try:
        about = reading.json_value(reading.content(folder / "mission.json"))
        if not isinstance(about, dict) or about.get("format") != FORMAT:
            raise ValueError("mission.json has another format")
        if about.get("schema_version") != SCHEMA_VERSION:
            raise ValueError(
                f"mission.json must have version {SCHEMA_VERSION}, got {about.get('schema_version')}"
            )
        schema = columns.of_mission()
        table = tables.csv(
            reading.content(folder / "episodes.csv", reading.DATA), schema, words=("condition",)
        )
        table = columns.checked(table, schema)
        if not 0 <= number < len(table):
            raise UserError(f"--episode {number}: {folder} has missions 0 to {len(table) - 1}")
        data = reading.content(folder / "trajectories.npz", reading.DATA)
        stored = archives.paths(data, CONDITION, [number])
        arrays: dict[str, Any] = {
            name: np.asarray(stored[f"{name}_{CONDITION}_{number}"], dtype=np.float32) for name in ARRAYS
        }
        frequency = float(about["frequency_hz"])
        limits: dict[str, Any] = {
            key: float(about[f"{key}_m"]) for key in ("goal_radius", "depth_low", "depth_high")
        }
        actuators = tuple(str(name) for name in about["actuators"])
        _check_shapes(arrays, len(actuators))
        controller = str(about["controller"])
    except (OSError, ValueError, KeyError, TypeError, *archives.FAULTS) as error:
        raise RunError(f"{folder}: missions cannot be read: {error}") from error
    config = train_config(compose("train", ["algo=pid"], folder=None))
    return Replay(
        run=controller,
        protocol="mission",
        condition=CONDITION,
        config=replace(
            config, task=replace(config.task, **limits), step=replace(config.step, frequency=frequency)
        ),
        actuators=actuators,
        record={str(key): value for key, value in table.iloc[number].to_dict().items()},
        **arrays,
    )


def _check_shapes(arrays: dict[str, Floats], n_u: int) -> None:
    """Raise ValueError unless all arrays of an episode have the right length and are finite."""
    n = len(arrays["time"])
    shapes = {"time": (n,), "position": (n, 3), "yaw": (n,), "command": (n - 1, n_u), "waypoint": (3,)}
    for name, array in arrays.items():
        if array.shape != shapes[name]:
            raise ValueError(f"{name} has shape {array.shape}, must be {shapes[name]}")
        if not np.isfinite(array).all():
            raise ValueError(f"{name} has numbers that are not finite")

"""A mission that a pilot recorded, as an episode to look at."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from auvbench.config.compose import compose
from auvbench.config.validate import train_config
from auvbench.errors import RunError, UserError
from auvbench.evaluation.replay import Replay
from auvbench.ros2.mission import CONDITION, FORMAT, SCHEMA_VERSION
from auvbench.untrusted import archives, documents, reading, tables


def is_one(folder: Path) -> bool:
    """Whether a folder holds missions."""
    return (folder / "mission.json").is_file()


def replay(folder: Path, number: int) -> Replay:
    """Mission `number` of a folder.

    Raises:
        RunError: its files are damaged, or of another version.
        UserError: there is no such mission.
    """
    try:
        about = documents.json_value(reading.content(folder / "mission.json"))
        if not isinstance(about, dict) or about.get("format") != FORMAT:
            raise ValueError("mission.json is of something else")
        if about.get("schema_version") != SCHEMA_VERSION:
            raise ValueError(
                f"mission.json is of version {about.get('schema_version')}, not {SCHEMA_VERSION}"
            )
        table = tables.csv(reading.content(folder / "episodes.csv", reading.DATA))
        if not 0 <= number < len(table):
            raise UserError(f"--episode {number}: {folder} holds missions 0 to {len(table) - 1}")
        row = {str(key): value for key, value in table.iloc[number].to_dict().items()}
        with archives.opened(reading.content(folder / "trajectories.npz", reading.DATA)) as arrays:
            found: dict[str, Any] = {
                name: np.asarray(arrays[f"{name}_{CONDITION}_{number}"], dtype=np.float32)
                for name in ("time", "position", "yaw", "command", "waypoint")
            }
        frequency = float(about["frequency_hz"])
        limits: dict[str, Any] = {
            key: float(about[f"{key}_m"]) for key in ("goal_radius", "depth_low", "depth_high")
        }
        actuators = tuple(str(name) for name in about["actuators"])
        title = f"{about['controller']}"
    except (OSError, ValueError, KeyError, TypeError, *archives.FAULTS) as error:
        raise RunError(f"{folder}: holds no missions that can be read: {error}") from error
    config = train_config(compose("train", ["algo=pid"], folder=None))
    config = dataclasses.replace(
        config,
        task=dataclasses.replace(config.task, **limits),
        step=dataclasses.replace(config.step, frequency=frequency),
    )
    return Replay(
        run=title,
        protocol="mission",
        condition=CONDITION,
        config=config,
        actuators=actuators,
        record=row,
        **found,
    )

"""Record a mission as an episode's row and a trajectory, without compiled code.

The sums are the same as in `auvbench/tasks/rows.py` (definitions: docs/protocol.md); a test compares them.
A mission has no reward, so its `return` is NaN.
"""

from __future__ import annotations

import csv
import io
import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from auvbench.errors import RunError
from auvbench.metrics import Totals
from auvbench.pilot.live_observation import yaw_of
from auvbench.record import ABORTED, Record, record_columns, record_of

Floats = NDArray[np.float64]

FORMAT = "auvbench-mission"
SCHEMA_VERSION = 1
CONDITION = "mission"


class Mission:
    """Record of a vehicle's motion towards one waypoint.

    Args:
        pose: (7,) pose at the start.
        waypoint: (3,) waypoint, m.
        depth: lowest and highest z, m.
        goal_radius: distance at which the waypoint is reached, m.
        max_steps: largest number of agent steps.
        frequency: rate of the agent, Hz.
    """

    def __init__(
        self,
        pose: Floats,
        waypoint: Floats,
        *,
        depth: tuple[float, float],
        goal_radius: float,
        max_steps: int,
        frequency: float,
    ) -> None:
        self.waypoint = np.array(waypoint, dtype=np.float64)
        self.depth, self.goal_radius, self.max_steps = depth, goal_radius, max_steps
        self.duration = 1.0 / frequency
        self.outcome = ""
        self.positions = [pose[:3].copy()]
        self.yaws = [yaw_of(pose)]
        self.actions: list[Floats] = []
        self.forces: list[Floats] = []
        self.powers: list[float] = []

    @property
    def steps(self) -> int:
        """Return the number of steps."""
        return len(self.forces)

    def advance(self, pose: Floats, action: Floats, force: Floats, power: float) -> str:
        """Add one step; return the outcome if the step ended the mission, else ''.

        Args:
            pose: (7,) pose after the step.
            action: (n_u,) action in [-1, 1].
            force: (n_u,) forces of the thrusters, N.
            power: electrical power, W.
        """
        self.positions.append(pose[:3].copy())
        self.yaws.append(yaw_of(pose))
        self.actions.append(action)
        self.forces.append(force)
        self.powers.append(power)
        if not self.depth[0] <= pose[2] <= self.depth[1]:
            self.outcome = "collision"
        elif math.dist(pose[:3], self.waypoint) < self.goal_radius:
            self.outcome = "success"
        elif self.steps >= self.max_steps:
            self.outcome = "timeout"
        return self.outcome

    def record(self, number: int) -> Record:
        """Return the mission as the row of an episode, with the columns that tests of the task waypoint have."""
        x, y, z = self.waypoint.tolist()
        positions = np.array(self.positions)
        line, away = self.waypoint - positions[0], positions[1:] - positions[0]
        if np.any(line):
            deviation = np.linalg.norm(np.cross(away, line), axis=1) / np.linalg.norm(line)
        else:
            deviation = np.linalg.norm(away, axis=1)
        distance = np.linalg.norm(self.waypoint - positions, axis=1)
        change = np.diff(self.actions, axis=0, prepend=np.zeros((1, len(self.actions[0]))))
        margin = np.minimum(self.depth[1] - positions[:, 2], positions[:, 2] - self.depth[0])
        return record_of(
            Totals(
                episode=number,
                environment=0,
                outcome=self.outcome or ABORTED,
                steps=self.steps,
                step_s=self.duration,
                reward=math.nan,
                initial_distance=float(distance[0]),
                distance=float(distance[-1]),
                deviation=float(deviation.sum()),
                deviation_squared=float(np.square(deviation).sum()),
                command_norm=_length(self.forces),
                energy=sum(self.powers) * self.duration,
                path=_length(np.diff(positions, axis=0)),
                change=_length(change),
                depth_margin=float(margin.min()),
                start_yaw=self.yaws[0],
                own={"waypoint_x_m": x, "waypoint_y_m": y, "waypoint_z_m": z},
            ),
            "waypoint",
        )

    def trajectory(self) -> dict[str, NDArray[np.float32]]:
        """Return the mission's arrays under the names that tests use for trajectories.

        Shapes: position (T + 1, 3), yaw (T + 1,), command (T, n_u), waypoint (3,) and time (T + 1,).
        """
        return {
            "position": np.asarray(self.positions, dtype=np.float32),
            "yaw": np.asarray(self.yaws, dtype=np.float32),
            "command": np.asarray(self.forces, dtype=np.float32),
            "waypoint": np.asarray(self.waypoint, dtype=np.float32),
            "time": np.asarray(self.duration * np.arange(len(self.positions)), dtype=np.float32),
        }


def _length(vectors: ArrayLike) -> float:
    """Return the sum of the lengths of vectors (n, d)."""
    return float(np.linalg.norm(vectors, axis=1).sum())


class Logbook:
    """Missions in a folder: mission.json, episodes.csv, trajectories.npz, all complete after each mission.

    Args:
        folder: folder without a logbook; created if it does not exist.
        about: controller and vehicle, for mission.json.

    Raises:
        RunError: the folder contains a logbook, or cannot be written.
    """

    def __init__(self, folder: Path, about: Mapping[str, Any]) -> None:
        self.folder = folder
        self._about = {"format": FORMAT, "schema_version": SCHEMA_VERSION, **about}
        self._rows: list[Record] = []
        self._reasons: list[str] = []
        self._arrays: dict[str, NDArray[np.float32]] = {}
        if (folder / "mission.json").exists():
            raise RunError(f"--record {folder}: already has missions; name another folder")
        self._write()

    def add(self, mission: Mission, reason: str) -> None:
        """Write a mission that ended for `reason`."""
        number = len(self._rows)
        self._rows.append(mission.record(number))
        self._reasons.append(reason)
        for name, array in mission.trajectory().items():
            self._arrays[f"{name}_{CONDITION}_{number}"] = array
        self._write()

    def _write(self) -> None:
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(("condition", "frequency_hz", *record_columns("waypoint")))
        for row in self._rows:
            writer.writerow((CONDITION, self._about["frequency_hz"], *row.values()))
        arrays = io.BytesIO()
        np.savez_compressed(arrays, **self._arrays)  # type: ignore[arg-type]
        about = json.dumps({**self._about, "ends": self._reasons}, indent=2) + "\n"
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            for name, data in (
                ("episodes.csv", text.getvalue().encode()),
                ("trajectories.npz", arrays.getvalue()),
                ("mission.json", about.encode()),
            ):
                staged = self.folder / f".{name}.staged"
                staged.write_bytes(data)
                os.replace(staged, self.folder / name)
        except OSError as error:
            raise RunError(f"--record {self.folder}: cannot be written: {error.strerror or error}") from error

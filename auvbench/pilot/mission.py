"""The record of a mission: an episode's row and a trajectory, computed in plain Python.

The sums are those of `auvbench/tasks/kernels.py` (definitions: docs/protocol.md); a test compares the two. A mission has
no reward: its `return` is NaN.
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
from numpy.typing import NDArray

from auvbench.errors import RunError
from auvbench.metrics import Totals
from auvbench.pilot.observation import yaw_of
from auvbench.record import Record, record_columns, record_of

Floats = NDArray[np.float64]

FORMAT = "auvbench-mission"
SCHEMA_VERSION = 1
CONDITION = "mission"
ABORTED = "aborted"
"""Outcome of a mission that was ended from outside; mission.json has the reason."""


class Mission:
    """One way to a waypoint.

    Args:
        pose: (7,) where it begins.
        waypoint: (3,) m.
        depth: lowest and highest z in m.
        goal_radius: m.
        max_steps: of the agent.
        frequency: Hz of the agent.
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
        self.start_yaw = yaw_of(pose)
        self.initial = self.distance = math.dist(pose[:3], waypoint)
        self.outcome = ""
        self.positions: list[list[float]] = [pose[:3].tolist()]
        self.yaws = [self.start_yaw]
        self.forces: list[list[float]] = []
        self._previous: list[float] | None = None
        self._deviation = self._deviation_squared = self._norm = 0.0
        self._energy = self._path = self._change = 0.0
        z = float(pose[2])
        self._margin = min(depth[1] - z, z - depth[0])

    @property
    def steps(self) -> int:
        """Number of steps."""
        return len(self.forces)

    def advance(self, pose: Floats, action: Floats, force: Floats, power: float) -> str:
        """Add one step; return the outcome if that ended the mission, else an empty text.

        Args:
            pose: (7,) after the step.
            action: (n_u,) in [-1, 1].
            force: (n_u,) N of the thrusters.
            power: W.
        """
        x, y, z = pose[:3].tolist()
        bx, by, bz = self.waypoint.tolist()
        ax, ay, az = self.positions[0]
        distance = math.sqrt((bx - x) ** 2 + (by - y) ** 2 + (bz - z) ** 2)
        deviation = _from_line((x - ax, y - ay, z - az), (bx - ax, by - ay, bz - az))
        last = self.positions[-1]
        self._path += math.sqrt(sum((now - then) ** 2 for now, then in zip((x, y, z), last, strict=True)))
        self._deviation += deviation
        self._deviation_squared += deviation * deviation
        self._norm += math.sqrt(sum(f * f for f in force.tolist()))
        self._energy += power * self.duration
        now = action.tolist()
        before = self._previous or [0.0] * len(now)
        self._change += math.sqrt(sum((a - b) ** 2 for a, b in zip(now, before, strict=True)))
        self._previous = now
        self._margin = min(self._margin, self.depth[1] - z, z - self.depth[0])
        self.distance = distance
        self.positions.append([x, y, z])
        self.yaws.append(yaw_of(pose))
        self.forces.append(force.tolist())
        if not self.depth[0] <= z <= self.depth[1]:
            self.outcome = "collision"
        elif distance < self.goal_radius:
            self.outcome = "success"
        elif self.steps >= self.max_steps:
            self.outcome = "timeout"
        return self.outcome

    def record(self, number: int) -> Record:
        """Return the row of an episode, columns as in a test of the waypoint task."""
        x, y, z = self.waypoint.tolist()
        return record_of(
            Totals(
                episode=number,
                environment=0,
                outcome=self.outcome or ABORTED,
                steps=self.steps,
                step_s=self.duration,
                reward=math.nan,
                initial_distance=self.initial,
                distance=self.distance,
                deviation=self._deviation,
                deviation_squared=self._deviation_squared,
                command_norm=self._norm,
                energy=self._energy,
                path=self._path,
                change=self._change,
                depth_margin=self._margin,
                start_yaw=self.start_yaw,
                own={"waypoint_x_m": x, "waypoint_y_m": y, "waypoint_z_m": z},
            ),
            "waypoint",
        )

    def trajectory(self) -> dict[str, NDArray[np.float32]]:
        """Return a test's arrays: position (T + 1, 3), yaw, command (T, n_u), waypoint (3,), time."""
        return {
            "position": np.asarray(self.positions, dtype=np.float32),
            "yaw": np.asarray(self.yaws, dtype=np.float32),
            "command": np.asarray(self.forces, dtype=np.float32),
            "waypoint": np.asarray(self.waypoint, dtype=np.float32),
            "time": np.asarray(self.duration * np.arange(len(self.positions)), dtype=np.float32),
        }


def _from_line(p: tuple[float, float, float], b: tuple[float, float, float]) -> float:
    """Return the distance of p from the line through the origin and b."""
    cx = p[1] * b[2] - p[2] * b[1]
    cy = p[2] * b[0] - p[0] * b[2]
    cz = p[0] * b[1] - p[1] * b[0]
    length = b[0] * b[0] + b[1] * b[1] + b[2] * b[2]
    if length > 0.0:
        return math.sqrt((cx * cx + cy * cy + cz * cz) / length)
    return math.sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2])


class Logbook:
    """Missions in a folder: mission.json, episodes.csv, trajectories.npz, all complete after each mission.

    Args:
        folder: is created if it does not exist; must not hold a logbook.
        about: controller and vehicle, for mission.json.

    Raises:
        RunError: the folder holds a logbook, or cannot be written.
    """

    def __init__(self, folder: Path, about: Mapping[str, Any]) -> None:
        self.folder = folder
        self._about = {"format": FORMAT, "schema_version": SCHEMA_VERSION, **about}
        self._rows: list[Record] = []
        self._reasons: list[str] = []
        self._arrays: dict[str, NDArray[np.float32]] = {}
        if (folder / "mission.json").exists():
            raise RunError(f"--record {folder}: holds missions already; name another folder")
        self._write()

    def add(self, mission: Mission, reason: str) -> None:
        """Write a mission that has ended for `reason`."""
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

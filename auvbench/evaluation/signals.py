"""Record what a vehicle did and what its agent saw in an episode, step by step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from auvbench.dynamics import frames
from auvbench.envs.batch import Batch

Floats = NDArray[np.float64]

POSITION = ("x_m", "y_m", "z_m")
ATTITUDE = ("roll_rad", "pitch_rad", "yaw_rad")
VELOCITY = ("u_mps", "v_mps", "w_mps")
RATES = ("p_radps", "q_radps", "r_radps")
REFERENCE = tuple(f"reference.{name}" for name in POSITION)
CURRENT = tuple(f"current.{name}_mps" for name in ("east", "north", "up"))
ESTIMATE = tuple(f"estimate.{name}" for name in (*POSITION, *ATTITUDE, *VELOCITY, *RATES))
ERROR, DEVIATION = (tuple(f"estimate.{what}_{name}" for name in POSITION) for what in ("error", "sd"))
POWER, DISTANCE, REWARD = "vehicle.power_W", "reference.distance_m", "task.reward"
_SUFFIX = {"m": "_m", "rad": "_rad", "m/s": "_mps", "rad/s": "_radps"}


@dataclass(frozen=True, slots=True)
class Panel:
    """Columns of the signals' table that share one panel of a figure."""

    title: str
    unit: str
    columns: tuple[str, ...]
    labels: tuple[str, ...] = ()
    dashed: tuple[str, ...] = ()
    """columns that are drawn dashed, in the colours of `columns`"""


@dataclass(frozen=True, slots=True, eq=False)
class Signals:
    """Signals of an episode of T steps."""

    table: pd.DataFrame
    """T + 1 rows: the start, and the end of each step. Columns without a dot have the same names as in logs for `auvbench identify`."""
    motion: tuple[Panel, ...]
    """Panels of the vehicle's motion, commands, forces and power, of the reward, and of the current"""
    observed: tuple[Panel, ...]
    """panels of the observation, one per block"""


class Recorder:
    """Recorder of the signals of a batch's first environment; a `rollout.Watch`."""

    def __init__(self) -> None:
        self._rows: list[Floats] = []
        self._commands: list[Floats] = []
        self._batch: Batch | None = None

    def __call__(self, environments: Batch) -> None:
        """Record the state as a row, and the command of the step that has just ended; the first call records only the start."""
        self._batch, started = environments, bool(self._rows)
        simulator, task = environments.simulator, environments.task
        pose, power = simulator.pose[0], simulator.power
        if environments.disturbances is not None:
            power = environments.disturbances.power
        if started:
            self._commands.append(environments.acted[0].copy())
        self._rows.append(
            np.concatenate(
                [
                    pose[:3],
                    frames.euler(pose[3:7]),
                    simulator.velocity[0],
                    task.reference[0],
                    task.distance[:1],
                    power[:1] if started else [0.0],
                    task.reward[:1] if started else [0.0],
                    _current(simulator, float(pose[2])),
                    simulator.command_force[0],
                    simulator.effectiveness[0],
                    _estimate(environments),
                    task.observation[0],
                ]
            )
        )

    def signals(self, duration: float) -> Signals:
        """Return the signals of the episode, whose steps take `duration` s."""
        assert self._batch is not None
        names = self._batch.vehicle.actuators
        forces = tuple(f"force.{name}_N" for name in names)
        working = tuple(f"working.{name}" for name in names)
        estimate = () if self._batch.navigation is None else (*ESTIMATE, *ERROR, *DEVIATION)
        blocks = self._batch.task.spec.blocks.values()
        labels_of = {
            b.name: tuple(f"observed.{label}{_SUFFIX.get(b.unit, '')}" for label in b.labels) for b in blocks
        }
        columns = (*POSITION, *ATTITUDE, *VELOCITY, *RATES, *REFERENCE, DISTANCE, POWER, REWARD, *CURRENT, *forces, *working, *estimate)  # fmt: skip
        table = pd.DataFrame(
            np.array(self._rows), columns=[*columns, *(c for part in labels_of.values() for c in part)]
        )
        commands = tuple(f"{name}_cmd" for name in names)
        # Each row has the command of the step that begins at its time. The last row repeats the last command, like a log.
        sent = pd.DataFrame(np.array([*self._commands, self._commands[-1]]), columns=list(commands))
        table = pd.concat([pd.Series(duration * np.arange(len(table)), name="t_s"), sent, table], axis=1)
        motion = [
            Panel("Position; dashed: reference", "m", POSITION, ("x", "y", "z"), REFERENCE),
            Panel("Distance to the reference", "m", (DISTANCE,)),
            Panel("Attitude", "degrees", ATTITUDE, ("roll", "pitch", "yaw")),
            Panel("Velocity", "m/s", VELOCITY, ("forward", "port", "up")),
            Panel("Rates", "rad/s", RATES, ("roll", "pitch", "yaw")),
            Panel("Commands", "share of the largest", commands, names),
            Panel("Forces", "N", forces, names),
            Panel("Electrical power", "W", (POWER,)),
            Panel("Reward of a step", "", (REWARD,)),
        ]
        if estimate:
            title = "Error of the estimated position; dashed: its standard deviation"
            motion.append(Panel(title, "m", ERROR, ("x", "y", "z"), DEVIATION))
        if _changes(table, CURRENT, 0.0):
            motion.append(Panel("Current at the vehicle", "m/s", CURRENT, ("east", "north", "up")))
        if _changes(table, working, 1.0):
            motion.append(Panel("Share of the thrust that is left", "", working, names))
        observed = [
            Panel(
                f"Observed: {b.name}",
                b.unit if b.unit != "1" else "",
                labels_of[b.name],
                tuple(label.removeprefix(f"{b.name}_") for label in b.labels),
            )
            for b in blocks
        ]
        return Signals(table, tuple(motion), tuple(observed))


def _changes(table: pd.DataFrame, columns: Sequence[str], usual: float) -> bool:
    """Return whether any of the columns has a value that differs from `usual`."""
    return bool((table[list(columns)] != usual).any(axis=None))


def _estimate(environments: Batch) -> Floats:
    """Return the navigation's estimate (18,) of the first vehicle; (0,) without navigation.

    The first 12 values are the estimated pose (position and Euler angles) and velocity. Then follow the position's
    errors (3,) and standard deviations (3,).
    """
    navigation = environments.navigation
    if navigation is None:
        return np.empty(0)
    pose, deviation = navigation.pose[0], np.sqrt(np.diag(navigation.covariance[0])[:3])
    error = pose[:3] - environments.simulator.pose[0, :3]
    return np.concatenate([pose[:3], frames.euler(pose[3:7]), navigation.velocity[0], error, deviation])


def _current(simulator: Any, z: float) -> Floats:
    """Return the current (3,) in m/s at the height `z` in m, without waves."""
    current: Floats | None = getattr(simulator, "current", None)
    if current is None:
        return np.zeros(3)
    top, change, (start, per_thickness) = current[0, :3], current[0, 3:6], current[0, 6:8]
    return np.asarray(top + change * min(max((start - z) * per_thickness, 0.0), 1.0))

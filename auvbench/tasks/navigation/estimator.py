"""The navigation of N episodes: sensors and an estimator, as the batch of environments calls them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from auvbench.config import schema
from auvbench.dynamics.layout import CURRENT
from auvbench.simulators.base import Simulator
from auvbench.tasks import records
from auvbench.tasks.navigation import loops
from auvbench.tasks.navigation.model import Sheet
from auvbench.tasks.navigation.state import FIELDS, parameters
from auvbench.worlds.solids import NO_HEIGHTS, SOLID

if TYPE_CHECKING:
    from auvbench.tasks.base import Task
    from auvbench.vehicles.vehicle_model import VehicleModel

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_VIEWS = ("_state", "_parameters")
"""Attributes that `_take` creates; a pickled `Navigation` does not contain them"""


class Navigation:
    """Sensors and estimates of N episodes.

    Order of calls: `begin` after the simulator's reset; `sample` after each of the `intervals` of a step; `conclude` at
    the end of an agent step, after the task has advanced.

    Args:
        config: configuration with an estimator and its sensors.
        vehicle: vehicle of all episodes.
        task: task of the episodes.
    """

    def __init__(self, config: schema.TrainConfig, vehicle: VehicleModel, task: Task) -> None:
        self.task, self.is_filter = task, config.navigation.is_filter
        self.rate = float(config.sensors.imu.rate)  # type: ignore[union-attr]
        """Sampling rate of the IMU, Hz"""
        shared = {name: task.parameters[name][0] for name in records.PARAMETERS}
        owner = f"navigation={config.navigation.name}"
        self.parameters = records.one_row(parameters(config, float(vehicle.gravity)), shared, owner)
        self.state = records.state(task.n, FIELDS, owner)
        """Sensors and estimate (n,) of each episode (`state.FIELDS`)"""
        has_model = bool(self.parameters[0].has_model)
        self.sheet = Sheet(vehicle, task.n, config.simulator.max_step) if has_model else None
        """Model from the vehicle's sheet; None if the estimator does not use it"""
        states = int(self.parameters[0].states)
        self.covariance: Floats = np.zeros((task.n, states, states))
        """Covariances (n, states, states) of the filter's errors (`ekf`)"""
        self.pose: Floats = np.zeros((task.n, 7))
        """Estimated poses (n, 7), m and unit quaternion"""
        self.velocity: Floats = np.zeros((task.n, 6))
        """Estimated velocities (n, 6), m/s and rad/s, body axes"""
        self._none = np.zeros(task.n, np.int64), np.zeros((task.n, 1), SOLID), NO_HEIGHTS
        task.estimated = self.columns
        self._take()

    def _take(self) -> None:
        self._state = records.plain(self.state)
        self._parameters = records.plain(self.parameters)

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without views, which NumPy would copy as separate arrays."""
        return {name: value for name, value in self.__dict__.items() if name not in _VIEWS}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._take()

    def watched(self, simulator: Simulator) -> Watched:
        """Return a simulator that lets the sensors measure during each of its steps."""
        return Watched(simulator, self)

    def intervals(self, duration: float) -> int:
        """Return the number of IMU samples in `duration` s."""
        return max(1, round(duration * self.rate))

    @property
    def _scene(self) -> tuple[Any, ...]:
        """Number of solids of each episode, the solids, and heights of terrain."""
        world = self.task.world
        return (
            (np.asarray(self.task.episodes["solids"]), world.solids, world.heights) if world else self._none
        )

    @staticmethod
    def _water(simulator: Any) -> Any:
        """Currents (n,) of the vehicles, as `rows.current_at` takes them."""
        water = simulator.current.view(CURRENT)[:, 0]
        return records.named(water) if records.INTERPRETED else water

    def begin(self, indices: Integers, simulator: Simulator) -> None:
        """Draw the sensors' errors and the first estimates of episodes whose vehicles are at their start positions."""
        task, true = self.task, (simulator.pose, simulator.velocity)
        task.begin_belief(indices)
        own = self._state, self._parameters, self.covariance, task.shown
        loops.begin_rows(indices, task.rows, *own, task.stream, *true, self.pose, self.velocity)
        if self.sheet is not None:
            self.sheet.begin(indices, self.pose, self.velocity)

    def sample(self, simulator: Any, seconds: float, start: int = 0, stop: int | None = None) -> None:
        """Let the sensors of environments start .. stop - 1 measure an interval of `seconds` s that ends now."""
        rows = start, self.task.n if stop is None else stop
        own = self.task.rows, self._state, self._parameters, self.covariance, self.task.stream
        true, water = (simulator.pose, simulator.velocity), self._water(simulator)
        waves = simulator.waves.components, simulator.waves.rays, simulator.waves.time
        loops.sample_rows(*rows, *own, *true, *self._scene, water, simulator.power, waves, seconds)
        if self.parameters[0].beacons:
            loops.range_rows(*rows, *own)

    def conclude(
        self, action: Floats, force: Floats, power: Floats, start: int = 0, stop: int | None = None
    ) -> None:
        """End an agent step: write the estimates, add their errors to the sums, and move the references that agents observe."""
        task, rows = self.task, (start, self.task.n if stop is None else stop)
        sheet = self.velocity
        if self.sheet is not None:
            self.sheet.follow(action, self.pose, self.velocity, task.duration, *rows)
            sheet = self.sheet.velocity
        own = task.rows, self._state, self._parameters, self.covariance, sheet, task.shown
        loops.conclude_rows(*rows, *own, task.stream, self.pose, self.velocity)
        task.move_belief(*rows, self.pose, self.velocity, action, task.previous, force, power)

    def columns(self, i: int) -> dict[str, float]:
        """Return the columns that navigation adds to the record of environment i, whose episode has ended."""
        d, e = self.state[i], self.task.episodes[i]
        steps = max(float(d.counted), 1.0)
        columns = {
            "navigation_error_rms_m": float(np.sqrt(d.error_squared_sum / steps)),
            "navigation_drift": float(d.error) / max(float(e.path_length), 1e-3),
            "unlocked_share": float(d.unlocked) / (steps * self.task.duration),
            "diverged": float(d.diverged),
        }
        return columns | ({"nees": float(d.nees) / steps} if self.is_filter else {})

    def state_dict(self) -> dict[str, NDArray[Any]]:
        """Return copies of the arrays that an exact resume needs."""
        sheet = {} if self.sheet is None else self.sheet.simulator.state_dict()
        own = {name: np.copy(array) for name, array in self._arrays().items()}
        return own | {f"sheet.{name}": array for name, array in sheet.items()}

    def load_state_dict(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Restore a state of `state_dict`."""
        for name, array in self._arrays().items():
            np.copyto(array, state[name], casting="no")
        if self.sheet is not None:
            names = self.sheet.simulator.state_dict()
            self.sheet.simulator.load_state_dict({name: state[f"sheet.{name}"] for name in names})

    def _arrays(self) -> dict[str, NDArray[Any]]:
        estimate = {"covariance": self.covariance, "pose": self.pose, "velocity": self.velocity}
        return {"state": records.bare(self.state), **estimate}


class Watched:
    """A simulator that lets navigation sensors measure during each of its steps.

    Args:
        simulator: wrapped simulator; the wrapper has the same attributes except `step`.
        navigation: sensors, which measure each interval of a step.
    """

    def __init__(self, simulator: Simulator, navigation: Navigation) -> None:
        self.simulator, self.navigation = simulator, navigation

    def __getattr__(self, name: str) -> Any:
        if name == "simulator":  # the attribute is missing while a copy is made
            raise AttributeError(name)
        return getattr(self.simulator, name)

    def step(self, command: Floats, duration: float) -> None:
        """Apply commands (n, n_u) for `duration` s, in the intervals of the IMU."""
        count = self.navigation.intervals(duration)
        for _ in range(count):
            self.simulator.step(command, duration / count)
            self.navigation.sample(self.simulator, duration / count)

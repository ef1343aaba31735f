"""Base class of tasks: N episodes with their start states, references, rewards, outcomes and records.

The file of a task declares functions of one episode, `draw` and `step`, and the task's fields, parameters and metrics.
This module does the rest: command noise, readings, observations, records, resets, and the state for an exact resume.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from auvbench import metrics
from auvbench.config import rewards, schema, tasks
from auvbench.config.navigation import READS, is_estimated
from auvbench.dynamics import frames
from auvbench.dynamics.random import TEST, VALIDATION
from auvbench.errors import TrainingError
from auvbench.metrics import OPEN, Totals
from auvbench.observation import ObservationSpec
from auvbench.record import OUTCOMES, Record, record_of
from auvbench.registry import BLOCKS, TASKS, owner, resolve
from auvbench.tasks import filters, loops, ranges, records, worlds
from auvbench.tasks import rewards as functions
from auvbench.tasks.bounds import bounded_spec, start_bounds
from auvbench.tasks.observation_spec import check_vehicle, owner_of_block, reads
from auvbench.tasks.rows import COLLISION, OUT_OF_BOUNDS, VEHICLE, add_command_noise
from auvbench.vehicles.vehicle_model import VehicleModel

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_STATE = ("preview", "previous", "offset", "observation")
_TAKEN = (
    "_observe",
    "rows",
    "_common",
    "outcome",
    "reference",
    "distance",
    "loops",
    "_arrays",
    "_read",
    "_around",
    "_sensed",
    "_believe",
    "shown",
    "_filtered",
)
"""Attributes of every task that `Task._take` creates; a pickled task does not contain them"""
GUARDED = ("draw_rows", "step_rows", "own_metrics", "records")
"""Methods that `installed.guard` replaces if a package provides the task or the reward. If a package provides a block,
`installed.guard` replaces `observe`.
"""


class Task:
    """State of N episodes of a task.

    Args:
        seed: seed of all draws, 0 .. 2^32 - 1.
        test: draw from the streams of tests, which no training uses.
        validation: draw from the streams of validation, which neither training nor tests use.
    """

    draw: ClassVar[Callable[..., float]]
    """`draw(e, p, stream) -> yaw`: begins the episode e. It writes the reference and `e.start`, and returns the start
    yaw in rad. Before the call, the task's own fields of e are 0"""
    step: ClassVar[Callable[..., int]]
    """`step(e, v, p) -> outcome`: updates the episode's fields after a step, and returns the outcome or GOES_ON.
    Before the call, `e.distance` and, if the reference has its own yaw, `e.yaw_error` are up to date"""
    refer: ClassVar[Callable[..., None]]
    """`refer(e, v, p)`, optional: moves the reference; called before `step`"""
    look: ClassVar[Callable[..., None]]
    """`look(e, v, p, solids, heights)`, optional: called after `refer`; measures the solids of a world. Only the first `e.solids` records
    of `solids` are in use"""
    preview_row: ClassVar[Callable[..., None]]
    """`preview_row(e, p, points)`, for tasks with the block `preview`: writes the future positions (points, 3) of the
    reference"""
    relocate: ClassVar[Callable[..., None]]
    """`relocate(e, p)`, optional: called after an episode's start was replaced; writes the reference for the new start"""
    fields: ClassVar[tuple[tuple[Any, ...], ...]] = ()
    """fields of an episode in addition to `records.EPISODE`: (name, type) or (name, type, shape)"""
    transient: ClassVar[tuple[str, ...]] = ()
    """Fields that each step writes before it reads them, so that digests and checkpoints of version 2 leave them out"""
    taken: ClassVar[tuple[str, ...]] = ()
    """Further attributes that the `_take` of a subclass creates"""
    success_ends: ClassVar[bool] = True
    """Whether success ends the episode; if not, the episode runs to its time limit, and success is a property of the whole episode"""
    reference_columns: ClassVar[tuple[str, ...]] = ()
    """Columns of a record that a fingerprint covers (`evaluation.reference`); empty: all columns of the task. With
    declared columns a new metric does not change the fingerprints of published results."""
    reference_blocks: ClassVar[tuple[str, ...]] = ()
    """Blocks of an observation that a fingerprint covers; empty: all blocks of the task"""
    reference_key: ClassVar[str] = "reference"
    """Name of the reference in `info`"""
    hidden: ClassVar[bool] = False
    """Whether agents never know the true reference: the task writes the vehicle's estimate of the reference into `believed`, even if the
    vehicle knows its pose"""
    owners: tuple[str, str] | None = None
    """Names of task and reward for messages; None if neither comes from a package. `installed` checks the results of task and reward"""

    def __init__(
        self,
        config: schema.TrainConfig,
        vehicle: VehicleModel,
        n: int,
        seed: int,
        *,
        test: bool = False,
        validation: bool = False,
    ) -> None:
        self.vehicle = vehicle
        self.n = n
        self.team = config.task.team
        """Number of vehicles in an episode; they are consecutive rows"""
        self.name = config.task.name
        self.frequency = config.step.frequency
        self.noise_scale = _command_noise_scale(config.noise, vehicle)
        n_u = len(vehicle.actuators)
        self.spec: ObservationSpec = bounded_spec(config, vehicle)
        """Specification of the observation"""
        self.reach = start_bounds(config, vehicle)
        """Largest position errors (3,) at the start of an episode, m"""
        self.limits = _limits(config)
        """Values that replace the errors of a failed episode, by the names that `Metric.failed` uses"""
        self.reads_velocity = reads(config.task, "velocity")
        """Whether a block of the observation reads the vehicle's velocity"""
        self._names = names = tasks.blocks(config.task)
        self.block_owners = {name: owner_of_block(name, config.task) for name in config.task.block_packages}
        """Names in messages of the blocks that come from packages, by block; `installed` checks the numbers that these blocks write"""
        codes = [spec.name for spec in loops.observed(names)]
        self._codes = np.array([codes.index(name) for name in names], dtype=np.int64)
        self._sizes = np.array([len(self.spec.blocks[name].labels) for name in names], dtype=np.int64)
        shared, owner_name = _shared(config), owner("task", config.task)
        self.sensors = ranges.make(config, n, shared)
        """Range sensors; None if the observation has no range sensor"""
        self.parameters = records.one_row(self.own_parameters(config.task), shared, owner_name)
        """(1,) parameters of the task"""
        records.check_names(config.reward, owner("reward", config.reward))
        prices = records.of_schema(config.reward)
        self.prices = records.one_row(prices, shared, owner("reward", config.reward))
        """(1,) parameters of the reward"""
        self.duration = float(self.parameters[0].duration)
        """Duration of an agent step, s of simulated time"""
        self.world = worlds.make(config, vehicle, n)
        """World with the solids in the water; None in open water"""
        self.filter = filters.make(config, vehicle, self.spec, n)
        """Filter of the agent's commands; None if the configuration has no filter"""
        self.own_fields = (*self.fields, *(self.world.fields if self.world else ()))
        """fields of an episode in addition to `records.EPISODE`"""
        self.episodes = records.table(n, self.own_fields, owner_name)
        """Records (n,) of the episodes"""
        points = config.task.preview.points if isinstance(config.task, tasks.Tracked) else 0
        self.preview: Floats = np.zeros((n, points, 3))
        """Future positions (n, points, 3) of the references, m"""
        self.navigation_name = config.navigation.name
        estimated = is_estimated(config) or self.hidden
        self.believed: Any = (
            records.table(n, (*self.own_fields, *records.BELIEF), owner_name) if estimated else None
        )
        """Episodes (n,) as the estimator believes them to be; observations read them. None: observations read the true episodes"""
        self.believed_preview: Floats = np.zeros((n if estimated else 0, points, 3))
        self.estimated: Callable[[int], dict[str, float]] | None = None
        """Function that returns the columns that the estimator adds to the record of environment i"""
        self._reward, self._sight = functions.function_of(config.reward), functions.sight_of(config.reward)
        self._take(interpreted=False)
        self.seed = int(seed)
        self.reseed(seed)
        self.previous: Floats = np.zeros((n, n_u))
        self.offset: Floats = np.zeros((n, 4))
        """Errors (n, 4) of the position (m) and yaw (rad) readings, which disturbances write"""
        self.reward: Floats = np.zeros(n)
        self.command: Floats = np.zeros((n, n_u))
        self.observation = np.zeros((n, self.spec.size), dtype=np.float32)
        self._all = np.arange(n)
        self.stream = VALIDATION if validation else TEST if test else 0
        """flag of the random streams: 0, TEST or VALIDATION"""

    def _take(self, *, interpreted: bool) -> None:
        """Store the loops that call the task's functions and reward, and views of the arrays for these loops."""
        self._interpreted = interpreted
        self.rows = records.common(self.episodes)
        """View (n,) of the episodes with the fields that every task has, for functions that are compiled once for all tasks"""
        self._common = records.common_row(self.parameters)
        self.outcome: Integers = self.episodes.outcome
        """Outcomes (n,): indices into OUTCOMES; -1 during an episode"""
        self.reference: Floats = self.episodes.reference
        """Present reference positions (n, 3), m; in the waypoint task the waypoints"""
        self.distance: Floats = self.episodes.distance
        """Present distances (n,) to the references, m"""
        optional = [name for name in ("refer", "look", "preview_row", "relocate") if hasattr(self, name)]
        named = {name: getattr(type(self), name) for name in ("draw", "step", *optional)}
        if self.world and self._sight:
            named["sight"] = self._sight
        has_yaw = TASKS[self.name].has_yaw
        self._around: tuple[Any, ...] = self.world.loops if self.world else ()
        self.loops = loops.of_task(
            named,
            self._reward,
            self.own_fields,
            has_yaw=has_yaw,
            solid=self.world is not None,
            interpreted=interpreted,
        )
        tables = self.episodes, self.parameters, self.prices
        episodes, parameters, prices = tables if interpreted else map(records.plain, tables)
        self._arrays = episodes, self.preview, parameters, prices
        self._observe = loops.observe(loops.observed(self._names), interpreted=interpreted)
        believed = self.episodes if self.believed is None else self.believed
        own = any({"task", "team", READS} & {*BLOCKS[name].reads} for name in self._names)
        if interpreted or own:
            self._read = believed if interpreted else records.plain(believed), parameters
        else:
            self._read = records.common(believed), self._common
        """Episodes and parameters that blocks read; they have the task's own fields only if a block reads own fields"""
        self._believe: Any = believed if interpreted else records.plain(believed)
        self.shown = (
            () if self.believed is None else tuple(np.asarray(believed[name]) for name, *_ in records.BELIEF)
        )
        """arrays (n, 3) that blocks of the estimate read, in the order of `records.BELIEF`"""
        self._sensed: tuple[Any, ...] = ()
        """Arguments of the observing loop for range sensors"""
        if self.sensors and self.world:
            counts, scenery = np.asarray(self.episodes["solids"]), self.world.loops[:2]
            self._sensed = counts, *scenery, *self.sensors.tables(interpreted)
        self._filtered: tuple[Any, ...] = () if self.filter is None else self.filter.around(self)
        """Arguments that the filter takes from the task"""

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without the attributes that `__setstate__` creates.

        NumPy would copy a view as a separate array, which would no longer change with the episodes.
        """
        return {
            name: value
            for name, value in self.__dict__.items()
            if name not in (*_TAKEN, *self.taken, *GUARDED, "observe")
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._take(interpreted=self._interpreted)
        if self.owners or self.block_owners:
            from auvbench.tasks import installed

            installed.guard(self)

    def own_parameters(self, task: Any) -> dict[str, Any]:
        """Return the task's parameters by name: numbers, or lists of numbers."""
        return records.of_schema(task)

    def own_metrics(self, i: int) -> dict[str, float]:
        """Return the task's own columns of the record of environment i, whose episode has ended."""
        return {}

    def reseed(self, seed: int, indices: Integers | None = None) -> None:
        """Reset the episode counters of all or some environments, so that episode 0 of a seed comes next.

        Environment i draws from (seed, i); with teams, team t draws from (seed, t).
        """
        rows = np.arange(self.n) if indices is None else indices
        if len(rows) == self.n:
            self.seed = int(seed)
        self.episodes.seed[rows] = seed
        self.episodes.environment[rows] = rows // self.team + VEHICLE * (rows % self.team)
        self.episodes.episode[rows] = -1

    def reseed_each(self, indices: Integers, seeds: Integers) -> None:
        """Reset the episode counters of environments `indices` (k,), so that episode 0 of their `seeds` (k,) comes next.

        Each of these environments draws the same numbers as environment 0 with its seed.
        """
        self.episodes.seed[indices] = seeds
        self.episodes.environment[indices] = VEHICLE * (indices % self.team)
        self.episodes.episode[indices] = -1

    def assign(self, episodes: Integers, environment: int = 0) -> None:
        """Make `episodes[i]` of `environment` the next episode of team i, or of environment i in a task without teams."""
        self.episodes.episode = np.repeat(episodes, self.team) - 1
        self.episodes.environment = environment + VEHICLE * (self._all % self.team)

    def reset(self, indices: Integers) -> Floats:
        """Begin the next episode of the given environments; return their start poses (len, 7)."""
        self.episodes.episode[indices] += 1
        self.previous[indices] = 0.0
        self.offset[indices] = 0.0
        pose = np.empty((len(indices), 7))
        self.draw_rows(indices, pose)
        if self.world is not None:
            self.world.draw(self, indices)
        if self.filter is not None:
            self.filter.begin(indices)
        return pose

    def draw_rows(self, indices: Integers, pose: Floats) -> None:
        """Draw episodes; write their start poses (k, 7)."""
        self.loops.draw(indices, *self._arrays[:3], self.stream, pose)

    def step_rows(self, start: int, stop: int, *motion: Floats) -> int:
        """Step episodes start .. stop - 1; return the number of ended episodes, or -1 - i if pose i is not finite."""
        return self.loops.step(start, stop, *motion, *self._arrays, self.reward, *self._around)

    def interpret(self) -> None:
        """Run the task's functions, reward and blocks as Python from now on, so that Python checks array indices.

        The functions of `rows` that the task's functions call stay compiled.
        """
        self._take(interpreted=True)

    def place(self, indices: Integers, pose: Floats, waypoint: Floats | None = None) -> None:
        """Replace the drawn start poses (k, 7) of environments that were just reset, and their goals if `waypoint` (k, 3) is given."""
        if waypoint is not None:
            self.reference[indices] = waypoint
        e, p = self.episodes, self.parameters[0]
        e.start[indices] = e.position[indices] = pose[:, :3]
        e.start_yaw[indices] = frames.yaw(pose[:, 3:])
        if self.loops.relocate is not None:
            self.loops.relocate(indices, *self._arrays[:3])
        distance = np.linalg.norm(self.reference[indices] - pose[:, :3], axis=1)
        e.distance[indices] = e.initial_distance[indices] = distance
        depth = pose[:, 2]
        e.depth_margin[indices] = np.minimum(p.depth_high - depth, depth - p.depth_low)
        if self.world is not None:
            self.world.draw(self, indices)

    def misplaced(self, i: int) -> str:
        """Return why environment i cannot begin at its start, with the valid range; '' if the start is valid."""
        error = np.abs(self.reference[i] - self.episodes[i].start)
        if self.parameters[0].body_frame:
            error[:2] = np.hypot(error[0], error[1])
        if (error <= self.reach).all():
            return ""
        away, most = (", ".join(f"{value:g}" for value in values) for values in (error, self.reach))
        return f"is ({away}) m from the {self.reference_key}; must be at most ({most}) m"

    # Each of the next three functions acts on the environments start .. stop - 1, by default on all; each thread has its own environments.

    def protect(
        self, pose: Floats, velocity: Floats, action: Floats, start: int = 0, stop: int | None = None
    ) -> None:
        """Let the filter, if any, change the actions (n, n_u) in [-1, 1] in place, given measured poses and velocities."""
        if self.filter is not None:
            stop = self.n if stop is None else stop
            self.filter.act(pose, velocity, action, self.observation, self._filtered, start, stop)

    def add_noise(self, action: Floats, start: int = 0, stop: int | None = None) -> Floats:
        """Return the command (n, n_u) for the actuators: an action (n, n_u) in [-1, 1] plus command noise, clipped to [-1, 1]."""
        own = self.rows, self._common, self.noise_scale, self.stream, self.command
        add_command_noise(start, self.n if stop is None else stop, action, *own)
        return self.command

    def advance(
        self,
        pose: Floats,
        velocity: Floats,
        action: Floats,
        force: Floats,
        power: Floats,
        start: int = 0,
        stop: int | None = None,
    ) -> int:
        """Compute rewards and outcomes after one agent step; return the result of `step_rows`, which `checked` evaluates."""
        stop = self.n if stop is None else stop
        return self.step_rows(start, stop, pose, velocity, action, self.previous, force, power)

    def checked(self, ended: int) -> int:
        """Return the result of `advance` as the number of episodes that ended.

        Raises:
            TrainingError: a simulated position is not finite.
        """
        if ended < 0:
            row = -1 - ended
            e = self.episodes[row]
            raise TrainingError(
                f"the simulated position of environment {row} is not finite after step {e.steps} of its episode {e.episode}"
            )
        return int(ended)

    def observe(
        self,
        pose: Floats,
        velocity: Floats,
        indices: Integers | None = None,
        seats: Floats | None = None,
    ) -> NDArray[np.float32]:
        """Return observations (n, n_obs) from measured poses and velocities; with `indices`, renew only these rows.

        Args:
            pose: (n, 7) measured poses.
            velocity: (n, 6) measured velocities.
            indices: indices of environments; None: all environments.
            seats: (n, 7) poses from which range sensors measure; None: `pose`.
        """
        rows = self._all if indices is None else indices
        episodes, parameters = self._read
        preview = self.preview if self.believed is None else self.believed_preview
        state = self.previous, episodes, preview, parameters, self._codes, self._sizes
        sensed = (pose if seats is None else seats, *self._sensed) if self._sensed else ()
        self._observe(rows, pose, velocity, self.offset, *state, self.stream, self.observation, *sensed)
        return self.observation

    def begin_belief(self, indices: Integers) -> None:
        """Copy the episodes that begin now into the believed episodes, because a vehicle knows its mission plan at the start."""
        for name in self.episodes.dtype.names:
            self.believed[name][indices] = self.episodes[name][indices]
        self.believed_preview[indices] = self.preview[indices]

    def move_belief(self, start: int, stop: int, *motion: Floats) -> None:
        """Move the references of the believed episodes after a step; `motion` begins with estimated poses and velocities."""
        self.loops.believe(start, stop, *motion, self._believe, self.believed_preview, self._arrays[2])

    def goal(self, i: int) -> Floats:
        """Return the goal (3,) of environment i in m: waypoint, station, dock, end of the path or curve."""
        return np.array(self.reference[i])

    def line(self, i: int) -> Floats | None:
        """Return points (k, 3) in m of the path of environment i; None in a task without a path."""
        return None

    def outlines(self, i: int, low: Floats, high: Floats, time: float) -> Floats:
        """Return segments (k, 2, 3) in m that draw environment i's solids inside a box, `time` s after the start of the episode.

        The world must not be open water.
        """
        assert self.world is not None
        return self.world.outlines(i, int(self.episodes[i].solids), low, high, time)

    def dock_yaw(self, i: int) -> float | None:
        """Return the yaw in rad with which a vehicle enters the dock of environment i; None in a task without a dock."""
        return None

    def records(self, indices: Integers) -> list[Record]:
        """Return the records of episodes that just ended."""
        return [self._counted(self.measured(int(i))) for i in indices]

    def measured(self, i: int) -> Record:
        """Return the record of environment i's episode as measured: `limits` do not replace the errors of a failed episode."""
        names = self.name, self.world_name, self.navigation_name
        return record_of(self._totals(i), *names, filtered=self.filter is not None)

    @property
    def world_name(self) -> str:
        """Return the name of the kind of world."""
        return self.world.settings.name if self.world else OPEN

    def _counted(self, record: Record) -> Record:
        if record["outcome"] in TASKS[self.name].failures:
            record |= metrics.of_failures(record, self.limits)
        return record

    def _totals(self, i: int) -> Totals:
        e = self.episodes[i]
        return Totals(
            episode=int(e.episode),
            environment=int(e.environment),
            outcome=OUTCOMES[e.outcome],
            steps=int(e.steps),
            step_s=self.duration,
            reward=float(e.reward_sum),
            initial_distance=float(e.initial_distance),
            distance=float(e.distance),
            deviation=float(e.deviation_sum),
            deviation_squared=float(e.deviation_squared_sum),
            command_norm=float(e.command_norm_sum),
            energy=float(e.energy),
            path=float(e.path_length),
            change=float(e.change_sum),
            depth_margin=float(e.depth_margin),
            start_yaw=float(e.start_yaw),
            own={
                **self.own_metrics(i),
                **(self.world.columns(e, i) if self.world else {}),
                **(self.estimated(i) if self.estimated else {}),
                **(self.filter.columns(i, int(e.steps)) if self.filter else {}),
            },
        )

    def state_dict(self) -> dict[str, NDArray[Any]]:
        """Return copies of the state that an exact resume needs."""
        return {name: np.copy(value) for name, value in self._state().items()}

    def load_state_dict(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Restore a state of `state_dict`, or of a checkpoint of version 2."""
        own = self._state()
        if "F" in state:
            preview = records.from_version_2(self.episodes, self.columns, state)
            state = {**state, "episodes": own["episodes"], "preview": preview.reshape(self.preview.shape)}
        for name, value in own.items():
            np.copyto(value, state[name], casting="no")

    def _state(self) -> dict[str, NDArray[Any]]:
        world = self.world.state() if self.world else {}
        sensed = self.sensors.arrays() if self.sensors else {}
        filtered = self.filter.state() if self.filter else {}
        own = {name: getattr(self, name) for name in _STATE}
        if self.believed is not None:
            own |= {"believed": records.bare(self.believed), "believed_preview": self.believed_preview}
        return {"episodes": records.bare(self.episodes)} | own | world | sensed | filtered

    @property
    def columns(self) -> list[str]:
        """Return the fields of `episodes` that a checkpoint of version 2 stores as columns of floats."""
        has_goal = TASKS[self.name].has_goal
        names = records.columns(self.episodes.dtype, TASKS[self.name].has_yaw, has_goal)
        # Only an observation block reads the shortest way. Without this way in the list, a scenario's digest does not depend on the block.
        shown = [name for name, *_ in self.world.way] if self.world else []
        return [name for name in names if name not in (*self.transient, *shown)]

    def scenario(self) -> Floats:
        """Return the episodes' fields (n, floats) for digests: `columns` and the preview."""
        parts = [self.episodes[name] for name in self.columns] + [self.preview]
        return np.concatenate([np.reshape(part, (self.n, -1)) for part in parts], axis=1)


class TrackingTask(Task):
    """Task whose reference has its own yaw, with the errors that these tasks share."""

    def misplaced(self, i: int) -> str:
        distance, most = float(self.episodes[i].distance), self.limits.get("bounds", math.inf)
        if distance > most:
            return f"is {distance:g} m from the reference; must be at most task.bounds={most:g} m"
        return super().misplaced(i)

    def errors(self, i: int, failed: float) -> dict[str, float]:
        """Return columns of a record: the RMS position and yaw errors, and the coordinates of start and goal.

        Args:
            i: index of the environment.
            failed: position error that is assigned to a failed episode, m.
        """
        e = self.episodes[i]
        squared, yaw_squared = float(e.error_squared_sum), float(e.yaw_error_squared_sum)
        counted = float(e.counted)
        lost = e.outcome in (COLLISION, OUT_OF_BOUNDS)
        points = {"start": e.start.tolist(), "goal": self.goal(i).tolist()}
        scenario = {
            f"{name}_{axis}_m": value
            for name, point in points.items()
            for axis, value in zip("xyz", point, strict=True)
        }
        return {
            "position_error_rms_m": failed if lost else math.sqrt(squared / max(counted, 1.0)),
            "yaw_error_rms_rad": math.sqrt(yaw_squared / max(counted, 1.0)),
            **scenario,
        }


def _shared(config: schema.TrainConfig) -> dict[str, float]:
    """Return the parameters that every task has (`records.PARAMETERS`)."""
    task, noise = config.task, config.noise
    values: dict[str, float] = {
        "depth_low": task.depth_low,
        "depth_high": task.depth_high,
        "max_steps": schema.step_limit(task, config.step.frequency),
        "duration": 1.0 / config.step.frequency,
        "body_frame": task.position_frame == "body",
        "both_signs": noise.sign == "both",
        "has_yaw": TASKS[task.name].has_yaw,
        "history": task.history,
    }
    for name in ("position", "yaw", "command"):
        size = getattr(noise, name)
        values[f"{name}_noise_low"] = size.low * noise.scale
        values[f"{name}_noise_high"] = size.high * noise.scale
    return values


def _limits(config: schema.TrainConfig) -> dict[str, float]:
    """Return the values that replace errors of failed episodes, by the names of `Metric.failed`.

    These values are the time limit in s and, for auvbench's own tasks with bounds, the bounds in m.
    """
    task = config.task
    limits = {"time": schema.step_limit(task, config.step.frequency) / config.step.frequency}
    if isinstance(task, tasks.Tracked) and not isinstance(task, tasks.TaskConfig):
        limits["bounds"] = task.bounds
    return limits


def _command_noise_scale(noise: schema.Noise, vehicle: VehicleModel) -> Floats:
    """Return the factors (n_u,) that convert command noise to units of the normalised action."""
    if noise.command_unit == "normalised":
        return np.ones(len(vehicle.actuators))
    limits = np.asarray(vehicle.command_limits, dtype=np.float64)
    return np.asarray(2.0 / (limits[:, 1] - limits[:, 0]), dtype=np.float64)


def make(config: schema.TrainConfig, vehicle: VehicleModel, n: int, seed: int, **stream: bool) -> Task:
    """Return N episodes of the configuration's task.

    Raises:
        ConfigError: the vehicle cannot do the task.
    """
    check_vehicle(config.task, vehicle)
    has_package = isinstance(config.task, tasks.TaskConfig) or config.task.block_packages
    if has_package or isinstance(config.reward, rewards.RewardConfig):
        from auvbench.tasks import installed

        return installed.make(config, vehicle, n, seed, **stream)
    return factory(config.task.name)(config, vehicle, n, seed, **stream)


def factory(name: str) -> type[Task]:
    """Return the class of a task."""
    task_class: type[Task] = resolve(TASKS[name].code)
    return task_class

"""Roll out an agent on all episodes of a condition as one batch, and time its actions."""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import count, islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.agents.base import Agent
from auvbench.config import schema
from auvbench.config.simulators import Fossen
from auvbench.dynamics import frames
from auvbench.envs.batch import Batch
from auvbench.envs.simulator_factory import at_once
from auvbench.record import Record
from auvbench.runs import provenance
from auvbench.worlds.outlines import round_path

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Watch = Callable[[Batch], None]
"""function called with the environments after the reset and after each step"""


ACTIONS = 200
WARM_UP = 3
"""number of first actions that are not timed, since they include compilation"""
SECONDS = 3.0
"""wall time in s after which no further action is timed; at least one action is timed"""


@dataclass(slots=True)
class Trajectory:
    """Trajectory of one episode."""

    position: list[Floats] = field(default_factory=list)  # (3,) m each
    yaw: list[float] = field(default_factory=list)  # rad
    command: list[Floats] = field(default_factory=list)  # (n_u,) N each
    waypoint: Floats = field(default_factory=lambda: np.zeros(3))  # (3,) m, goal
    reference: list[Floats] = field(default_factory=list)  # (3,) m each
    dock_yaw: float | None = None  # rad, heading in which a dock is entered
    outlines: Floats | None = None  # (k, 2, 3) m, segments that show the solids near the path, in a world
    others: list[Floats] = field(default_factory=list)  # (V - 1, 3) m each, the other vehicles of a team

    def follow(self, pose: Floats, reference: Floats) -> None:
        """Append the poses (V, 7) of a team and the reference (3,) of the first vehicle, to which this trajectory belongs."""
        self.reference.append(reference.copy())
        self.position.append(pose[0, :3].copy())
        self.yaw.append(float(frames.yaw(pose[0, 3:7])))
        if len(pose) > 1:
            self.others.append(pose[1:, :3].copy())

    def arrays(self, duration: float) -> dict[str, NDArray[np.float32]]:
        """Return the trajectory as float32 arrays by name.

        Every trajectory has position (T + 1, 3) m, yaw (T + 1,) rad, command (T, n_u) N, waypoint (3,) m and time
        (T + 1,) s. Some trajectories have more arrays:

        * a docking task: dock_yaw (1,) rad. The moving reference is left out, because the goal of the task is the dock;
        * another task with a moving reference: reference (T + 1, 3) m;
        * a world with solids: outlines (k, 2, 3) m, segments that show the solids near the path;
        * a team of V vehicles: others (T + 1, V - 1, 3) m.
        """
        reference = np.asarray(self.reference, dtype=np.float32)
        moves = self.dock_yaw is None and bool((reference != reference[:1]).any())
        return {
            **({"reference": reference} if moves else {}),
            **({} if self.outlines is None else {"outlines": self.outlines.astype(np.float32)}),
            **({"others": np.asarray(self.others, dtype=np.float32)} if self.others else {}),
            **({} if self.dock_yaw is None else {"dock_yaw": np.array([self.dock_yaw], dtype=np.float32)}),
            "position": np.asarray(self.position, dtype=np.float32),
            "yaw": np.asarray(self.yaw, dtype=np.float32),
            "command": np.asarray(self.command, dtype=np.float32),
            "waypoint": np.asarray(self.waypoint, dtype=np.float32),
            "time": np.asarray(duration * np.arange(len(self.position)), dtype=np.float32),
        }


@dataclass(slots=True)
class Rollout:
    """Result of one condition of a test."""

    records: list[Record]  # one per episode, in order
    trajectories: dict[int, Trajectory]  # by episode
    duration: float  # duration of an agent step, s
    actuators: tuple[str, ...]  # names of the columns of a trajectory's command
    notes: dict[str, int] = field(default_factory=dict)  # see `counted`

    @classmethod
    def joined(cls, parts: Sequence[Rollout]) -> Rollout:
        """Return one rollout from rollouts of consecutive parts of the episodes."""
        notes: Counter[str] = Counter()
        for part in parts:
            notes.update(part.notes)
        return cls(
            records=[record for part in parts for record in part.records],
            trajectories={episode: path for part in parts for episode, path in part.trajectories.items()},
            duration=parts[0].duration,
            actuators=parts[0].actuators,
            notes=dict(notes),
        )


def counted(agent: Agent) -> dict[str, int]:
    """Return the counters of an agent's `notes()`, such as its failed and late solves; {} if the agent lacks this method."""
    notes: Callable[[], Mapping[str, int]] | None = getattr(agent, "notes", None)
    return {} if notes is None else {str(name): int(number) for name, number in notes().items()}


def roll_out(
    config: schema.TrainConfig,
    agent: Agent,
    *,
    episodes: Integers,
    seed: int,
    batch: int,
    trajectories: int = 0,
    scenarios: str = "test",
    report: Callable[[int], None] = lambda _: None,
    watch: Watch | None = None,
) -> Rollout:
    """Run an agent through episodes (n,) of a seed until each episode has ended.

    Episode e is a function of (seed, e): its row depends neither on `batch` nor on other episodes.

    Args:
        config: configuration of the environments.
        agent: agent to run.
        episodes: (n,) numbers of the episodes.
        seed: seed of the scenarios.
        batch: number of episodes to simulate at a time.
        trajectories: number of first episodes whose trajectories are recorded.
        scenarios: stream of scenarios, test or validation.
        report: function called with the number of episodes that have just ended.
        watch: function called after the reset and after each step, such as a `signals.Recorder`.
    """
    records: list[Record] = []
    paths: dict[int, Trajectory] = {}
    duration = 1.0 / config.step.frequency
    actuators: tuple[str, ...] = ()
    before = counted(agent)
    # An agent whose control loop is faster than the agent step has its own simulator, which runs one episode at a time.
    own = getattr(agent, "simulator", None)
    batch = at_once(config, batch) if own is None else 1
    for start in range(0, len(episodes), batch):
        numbers = episodes[start : start + batch]
        environments = batch_of(scenarios, config, numbers, seed)
        if own is not None:
            environments.simulator = own(config, environments.vehicle, environments.navigation)
        actuators = environments.vehicle.actuators
        followed = numbers[: max(0, trajectories - start)].tolist()
        agent.reset(rows_of(numbers, environments.team))
        records += _one_batch(environments, agent, followed, paths, report, watch)
    notes = {name: number - before.get(name, 0) for name, number in counted(agent).items()}
    return Rollout(records, paths, duration, actuators, notes)


def one_episode(
    config: schema.TrainConfig,
    agent: Agent,
    protocol: schema.Protocol,
    episode: int,
    *,
    path: bool = True,
    watch: Watch | None = None,
) -> Rollout:
    """Run an agent through one episode of a protocol.

    The trajectory is recorded if `path` is true. `watch` is called after the reset and after each step.
    """
    return roll_out(
        config,
        agent,
        episodes=np.array([episode]),
        seed=protocol.seed,
        batch=1,
        trajectories=int(path),
        scenarios=protocol.scenarios,
        watch=watch,
    )


def batch_of(scenarios: str, config: schema.TrainConfig, episodes: Integers, seed: int) -> Batch:
    """Return a batch with one environment for each of the episodes (n,); an environment does not restart.

    `scenarios` is the stream of scenarios from which the episodes come: test or validation.
    """
    validation = scenarios == "validation"
    batch = Batch(
        config, len(episodes), seed=seed, test=not validation, validation=validation, autoreset=False
    )
    batch.task.assign(episodes)
    return batch


def rows_of(episodes: Integers, team: int) -> Integers:
    """Return the numbers (n * team,) of all vehicles in episodes (n,); a team of one vehicle has the episode's number."""
    return np.add.outer(team * np.asarray(episodes), np.arange(team)).ravel()


def embedded(config: schema.TrainConfig) -> schema.TrainConfig:
    """Return the configuration with its simulator replaced by the embedded simulator."""
    return replace(config, simulator=Fossen(name="fossen", max_step=0.01, threads=1))


def _one_batch(
    environments: Batch,
    agent: Agent,
    followed: list[int],
    paths: dict[int, Trajectory],
    report: Callable[[int], None],
    watch: Watch | None,
) -> list[Record]:
    observation = environments.reset()
    if watch is not None:
        watch(environments)
    # A slow agent may stop computing actions for ended episodes. The call `ended(rows)` gives it the rows of these episodes.
    spare = getattr(agent, "ended", None)
    rows: dict[int, Record] = {}
    task, simulator, team = environments.task, environments.simulator, environments.team
    # `episode_of` maps the row of an episode's first vehicle to the number of the episode.
    episode_of = dict(zip(range(0, environments.n, team), followed, strict=False))
    for i, episode in episode_of.items():
        paths[episode] = Trajectory(waypoint=task.goal(i), dock_yaw=task.dock_yaw(i))
        paths[episode].follow(simulator.pose[i : i + team], task.reference[i])
    while len(rows) < environments.n // team:
        running = [i for i in episode_of if i not in rows]
        result = environments.step(agent.act(observation))
        observation = result.observation
        if watch is not None:
            watch(environments)
        for i in running:
            paths[episode_of[i]].follow(simulator.pose[i : i + team], task.reference[i])
            paths[episode_of[i]].command.append(simulator.command_force[i].copy())
        before = len(rows)
        for i, record in zip(result.ended[::team].tolist(), result.records[::team], strict=True):
            # An ended episode is simulated until all episodes have ended; only its first record counts.
            rows.setdefault(i, record)
        if len(rows) > before:
            report(len(rows) - before)
        if spare is not None and len(result.ended):
            spare(result.ended)
    for i, episode in episode_of.items() if task.world else ():
        path = paths[episode]
        box = round_path(np.array([*path.position, path.waypoint]))
        path.outlines = task.outlines(i, *box, len(path.command) * task.duration)
    return [rows[i] for i in range(0, environments.n, team)]


def time_actions(agent: Agent, config: schema.TrainConfig) -> dict[str, Any]:
    """Return the median and 95th percentile of the processor time per action in ms, on one core, and the
    machine's processor.

    One episode runs at a time, as on a vehicle. The processor time of the whole process is measured instead of
    wall time, so that other work on the machine has less effect. The times are noisy, so they are not part of any
    row or digest. The embedded simulator provides the observations, even if the test uses another simulator.

    Raises:
        ActionError, RunError: an action of the agent is not valid.
    """
    config = embedded(config)
    actions = _times(agent, config)
    for _ in islice(actions, WARM_UP):
        pass
    times: list[float] = []
    begun = time.perf_counter()
    for seconds in islice(actions, ACTIONS):
        times.append(seconds)
        if time.perf_counter() - begun > SECONDS:
            break
    ms = 1e3 * np.asarray(times)
    return {
        "actions": len(times),
        "median_ms": round(float(np.median(ms)), 4),
        "p95_ms": round(float(np.percentile(ms, 95)), 4),
        "clock": "processor",
        "threads": 1,
        "cpu": provenance.host()["cpu"],
        "cores": os.cpu_count(),
        "load": round(os.getloadavg()[0], 2),
    }


def _times(agent: Agent, config: schema.TrainConfig) -> Iterator[float]:
    """Yield the processor time of each action in s, episode after episode."""
    # An agent that computes in another process has its own clock.
    clock: Callable[[], float] = getattr(agent, "processor_time", time.process_time)
    for episode in count():
        numbers = np.array([episode])
        batch = batch_of("validation", config, numbers, 0)
        observation = batch.reset()
        agent.reset(rows_of(numbers, batch.team))
        ended = False
        while not ended:
            before = clock()
            action = agent.act(observation)
            yield (clock() - before) / batch.team  # per vehicle
            result = batch.step(action)
            observation, ended = result.observation, len(result.ended) > 0

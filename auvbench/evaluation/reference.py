"""Compute digests of reference plays, which reveal changes of physics, task or disturbances.

A reference play is a short simulation of a condition: eight episodes with a fixed sequence of commands. The
digest covers observations, rewards, states and the task's record columns. Refactoring does not change the
digest; doubled drag, a changed sign in the reward or a changed precedence of outcomes does.

Machines may differ in the last bits of a sine. Numbers are therefore rounded to `DIGITS` digits of the largest
number of the same kind, and the play is too short for such differences to grow. The digest does not reveal
smaller changes, or changes after more than `STEPS` steps.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.config import rewards, schema, tasks
from auvbench.config.filters import unfiltered
from auvbench.config.navigation import no_sensors, truth
from auvbench.config.simulators import Fossen
from auvbench.envs.batch import Batch
from auvbench.envs.simulator_factory import at_frequency
from auvbench.evaluation.rollout import embedded
from auvbench.record import OUTCOMES, record_columns
from auvbench.registry import BLOCKS, TASKS
from auvbench.tasks.base import factory

Floats = NDArray[np.float64]

DIGITS = 6
STEPS = 24
LOOKS = (0, 7, STEPS - 1)
"""steps whose states enter the digest; only a few steps, because any number may be at a rounding boundary"""

FREQUENCY = 10.0
"""step frequency in Hz if the protocol does not fix a frequency"""

PLACES = np.array([0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99, 0.5])
"""Start positions of the vehicles in each episode, as a share of the way to the waypoint; from 0.99, the vehicles arrive"""

VELOCITY = np.array([0.5, -0.25, 0.125, 0.125, -0.25, 0.25])
"""initial velocity in m/s and rad/s, so that damping and Coriolis forces act from the first step"""

_REWARD = rewards.Thesis(name="thesis", k=40.0, length=20.0, success=500.0, collision=-550.0, regress=-10.0)
"""Reward of every reference play. It replaces the run's reward, which belongs to the agent but would change the record"""


def digest(config: schema.TrainConfig, frequency: float | None) -> str:
    """Return 16 hexadecimal digits of the reference play of a condition.

    Args:
        config: configuration of the condition; the reference play always uses the embedded simulator.
        frequency: step frequency of the protocol, Hz; None if each agent has its own.

    Raises:
        TrainingError: the simulation produced numbers that are not finite.
    """
    sha = hashlib.sha256()
    for name, values in _played(config, frequency):
        sha.update(name.encode())
        sha.update(rounded(values).tobytes())
    return sha.hexdigest()[:16]


def rounded(values: Floats) -> NDArray[np.int64]:
    """Return numbers as whole multiples of 10^-DIGITS times the power of ten below the largest absolute value.

    >>> rounded(np.array([1.0, 0.1234567891, -1e-12])).tolist()
    [1000000, 123457, 0]
    """
    largest = float(np.abs(values).max(initial=0.0))
    unit = 10.0 ** (np.floor(np.log10(largest)) - DIGITS) if largest > 0.0 else 1.0
    return np.asarray(np.rint(values / unit), dtype=np.int64)


def _played(config: schema.TrainConfig, frequency: float | None) -> Iterator[tuple[str, Floats]]:
    """Yield name and values of each quantity of the reference play."""
    n = len(PLACES)
    batch = Batch(_standard(config, frequency), n, seed=0, test=True, autoreset=False)
    batch.task.assign(np.arange(n))
    batch.reset()
    _set_out(batch)
    n, n_u = batch.n, len(batch.vehicle.actuators)
    series: dict[str, list[Floats]] = {
        name: [] for name in ("observation", "reward", "pose", "velocity", "power")
    }
    records: dict[int, dict[str, Any]] = {}
    for step in range(STEPS):
        # Multiples of 1/8 have the same bits on every machine.
        turn = 7 * step + 5 * np.arange(n)[:, None] + 3 * np.arange(n_u)
        result = batch.step((turn % 17 - 8) / 8.0)
        if step in LOOKS:
            simulator = batch.simulator
            look = (result.observation, result.reward, simulator.pose, simulator.velocity, simulator.power)
            for name, value in zip(series, look, strict=True):
                series[name].append(np.array(value, dtype=np.float64))
        # Use the measured values: a later rule replaces values of failed episodes, but must not change fingerprints.
        for index in result.ended.tolist():
            records.setdefault(index, batch.task.measured(index))
    for name, looks in series.items():
        yield name, np.stack(looks)
    yield "ended", np.array(sorted(records), dtype=np.float64)
    for column in batch.task.reference_columns or record_columns(batch.task.name):
        values = [records[i][column] for i in sorted(records)]
        numbers = [OUTCOMES.index(str(value)) for value in values] if column == "outcome" else values
        yield column, np.array(numbers, dtype=np.float64)


def _standard(config: schema.TrainConfig, frequency: float | None) -> schema.TrainConfig:
    """Return the condition's configuration with short episodes, and with fixed values of the agent's own keys."""
    task = replace(config.task, time_limit=None, max_steps=STEPS // 2, **_observed(config.task))
    config = config if isinstance(config.simulator, Fossen) else embedded(config)
    config = replace(config, navigation=truth(), sensors=no_sensors(), filter=unfiltered())
    standard = replace(config, task=task, reward=_REWARD, simulator=replace(config.simulator, threads=1))
    return at_frequency(standard, FREQUENCY if frequency is None else frequency)


def _observed(task: tasks.Task) -> dict[str, Any]:
    """Return the observation of the reference play, the same for every agent."""
    declared = factory(task.name).reference_blocks
    able = [name for name in TASKS[task.name].blocks if name in BLOCKS.own and name != "preview"]
    names = [*declared] or able
    frame = {} if isinstance(task, tasks.Tracked) else {"position_frame": "world"}
    return {**frame, "observation": names, "block_packages": {}, "history": 1}


def _set_out(batch: Batch) -> None:
    """Place and accelerate the vehicles: one is about to reach the goal, and one is about to leave the depth limits."""
    pose, velocity = batch.simulator.pose, batch.simulator.velocity
    waypoint = batch.task.reference
    pose[:, :3] += np.repeat(PLACES, batch.team)[:, None] * (waypoint - pose[:, :3])
    pose[-1, 2] = batch.config.task.depth_high - 0.0625
    velocity[:] = VELOCITY

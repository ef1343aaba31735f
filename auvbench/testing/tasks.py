"""Check tasks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench import metrics
from auvbench.config import schema
from auvbench.config.compose import compose
from auvbench.config.validate import train_config
from auvbench.envs.batch import Batch
from auvbench.errors import AgentError
from auvbench.record import OUTCOMES
from auvbench.registry import TASKS
from auvbench.testing.draws import ConformanceError, actions, run_checks, same

N, STEPS = 5, 40
"""Number of parallel episodes, and number of steps, of a check"""


def play(batch: Batch, steps: range, first: int = 0) -> tuple[dict[str, NDArray[Any]], list[dict[str, Any]]]:
    """Step a batch; return observations, rewards and ends (steps, n, ...), and the records of the episodes that ended."""
    series: dict[str, list[NDArray[Any]]] = {
        "observation": [],
        "reward": [],
        "terminated": [],
        "truncated": [],
    }
    records: list[dict[str, Any]] = []
    for step in steps:
        result = batch.step(actions(step, batch.n, len(batch.vehicle.actuators), first))
        for name, values in series.items():
            values.append(np.array(getattr(result, name)))
        records += result.records
    return {name: np.asarray(values) for name, values in series.items()}, records


def its_rows_do_not_depend_on_the_batch(config: schema.TrainConfig) -> None:
    """Check that an episode gives the same observations, rewards and ends in a batch of any size."""
    together = Batch(config, N, seed=3)
    first = together.reset().copy()
    results, _ = play(together, range(STEPS))
    for row in (0, N - 1):
        alone = Batch(config, row + 1, seed=3)
        same(alone.reset()[row], first[row], f"the first observation of row {row}")
        own, _ = play(alone, range(STEPS))
        for name, values in own.items():
            same(values[:, row], results[name][:, row], f"{name} of row {row} in a batch of {row + 1}")


def it_resumes_in_mid_episode(config: schema.TrainConfig) -> None:
    """Check that a batch continues from `state_dict` with the same bits."""
    whole = Batch(config, N, seed=3)
    whole.reset()
    play(whole, range(STEPS // 2))
    state = whole.state_dict()
    expected, records = play(whole, range(STEPS // 2, STEPS))
    fresh = Batch(config, N, seed=8)
    fresh.reset()
    fresh.load_state_dict(state)
    resumed, resumed_records = play(fresh, range(STEPS // 2, STEPS))
    for name, values in expected.items():
        same(resumed[name], values, f"{name} after a resume")
    if records != resumed_records:
        raise ConformanceError("the records of episodes differ after a resume")


def its_draws_are_functions_of_their_key(config: schema.TrainConfig) -> None:
    """Check that the same seed, stream and episode give the same start, and that a change of one of them changes the start."""

    def start(seed: int = 3, episode: int = 4, **stream: bool) -> NDArray[Any]:
        batch = Batch(config, 2, seed=seed, **stream)
        batch.task.assign(np.array([episode, episode + 1]))
        batch.reset()
        return np.concatenate([batch.task.scenario()[0], batch.simulator.pose[0]])

    if not np.array_equal(start(), start()):
        raise ConformanceError("the same seed and episode must give the same start, but two starts differ")
    for other in (start(seed=4), start(episode=5), start(test=True), start(validation=True)):
        if np.array_equal(start(), other):
            raise ConformanceError(
                "another seed, episode or stream must give another start, but gives the same"
            )


def its_episodes_end_with_records(config: schema.TrainConfig) -> None:
    """Check that episodes end by their time limit and write valid records.

    A record must have the task's columns, with finite values in range.
    """
    limit = 2 * STEPS
    short = replace(config, task=replace(config.task, max_steps=limit, time_limit=None))
    batch = Batch(short, N, seed=3)
    batch.reset()
    results, records = play(batch, range(limit))
    if len(records) < N:
        raise ConformanceError(
            f"only {len(records)} of {N} episodes have ended by their time limit of {limit} steps"
        )
    for name in ("observation", "reward"):
        if not np.isfinite(results[name]).all():
            raise ConformanceError(f"{name}: not finite everywhere")
    if (np.abs(results["observation"]) > batch.task.spec.bounds).any():
        raise ConformanceError("an observation is outside the bounds that its specification declares")
    ranges = {metric.name: (metric.low, metric.high) for metric in metrics.registered()}
    outcomes = TASKS[batch.task.name].outcomes
    for record in records:
        if tuple(record) != schema.columns_of(batch.config):
            raise ConformanceError(
                f"a record must have the task's declared columns in their order, but has {', '.join(record)}"
            )
        if record["outcome"] not in outcomes or record["outcome"] not in OUTCOMES:
            raise ConformanceError(
                f"an episode ended with the outcome {record['outcome']}; the task declares {', '.join(outcomes)}"
            )
        for name, value in record.items():
            if isinstance(value, str) or name in ("episode", "environment"):
                continue
            low, high = ranges[name]
            scenario = name.endswith(("_x_m", "_y_m", "_z_m", "_rad"))
            if not np.isfinite(value) or (not scenario and not low <= value <= high):
                raise ConformanceError(f"{name}={value}: must be finite and within [{low:g}, {high:g}]")


def its_functions_stay_within_their_arrays(config: schema.TrainConfig) -> None:
    """Check that the task's functions, run as Python, access only existing fields and indices.

    The functions of `auvbench.tasks.rows`, which the task's functions call, stay compiled.
    """
    steps = 3
    short = replace(config, task=replace(config.task, max_steps=steps, time_limit=None))
    batch = Batch(short, 2, seed=3)
    batch.task.interpret()
    try:
        batch.reset()
        task, simulator = batch.task, batch.simulator
        for step in range(steps):
            action = actions(step, batch.n, len(batch.vehicle.actuators))
            simulator.step(action, task.duration)
            task.checked(
                task.advance(
                    simulator.pose, simulator.velocity, action, simulator.command_force, simulator.power
                )
            )
        for row in range(2):
            task.own_metrics(row)
    except (AgentError, IndexError) as error:
        raise ConformanceError(f"{error}; `fields` must declare each value that an episode stores") from error


TASK_CHECKS: tuple[Callable[[schema.TrainConfig], None], ...] = (
    its_rows_do_not_depend_on_the_batch,
    it_resumes_in_mid_episode,
    its_draws_are_functions_of_their_key,
    its_episodes_end_with_records,
    its_functions_stay_within_their_arrays,
)
"""Checks of every task."""


def check_task(*overrides: str, only: Callable[[schema.TrainConfig], None] | None = None) -> None:
    """Check a task against its contract (`auvbench.tasks.base.Task`).

    Args:
        overrides: arguments of `auvbench train`: the task, `task=NAME`, and possibly a vehicle and
            disturbances.
        only: one of `TASK_CHECKS`; default: all.

    Raises:
        ConformanceError: the task breaks its contract.
        ConfigError: an override is wrong, or the vehicle cannot do the task.
    """
    config = train_config(compose("train", list(overrides)))
    run_checks(TASK_CHECKS, only, overrides, lambda check: check(config))

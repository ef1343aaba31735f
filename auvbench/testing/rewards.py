"""Check rewards."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from auvbench.config import schema
from auvbench.config.compose import compose
from auvbench.config.validate import train_config
from auvbench.envs.batch import Batch
from auvbench.errors import AgentError
from auvbench.record import OUTCOMES
from auvbench.registry import TASKS
from auvbench.tasks import rows
from auvbench.tasks.rewards import function_of
from auvbench.testing.draws import ConformanceError, actions, reseed_generators, run_checks, same, untouched
from auvbench.testing.tasks import play

N, STEPS = 5, 30
"""Number of parallel episodes, and number of steps, of a check"""


def its_numbers_do_not_depend_on_the_batch(config: schema.TrainConfig) -> None:
    """Check that a step gives the same finite reward in a batch of any size, and that no reward is drawn from a global generator."""
    reseed_generators(1)
    together = Batch(config, N, seed=3)
    together.reset()
    with untouched("the reward"):
        results, _ = play(together, range(STEPS))
    if not np.isfinite(results["reward"]).all():
        raise ConformanceError(f"a reward is {results['reward'][~np.isfinite(results['reward'])][0]:g}")
    for row in (0, N - 1):
        alone = Batch(config, row + 1, seed=3)
        alone.reset()
        own, _ = play(alone, range(STEPS))
        same(
            own["reward"][:, row], results["reward"][:, row], f"rewards of row {row} in a batch of {row + 1}"
        )


def it_pays_every_end(config: schema.TrainConfig) -> None:
    """Check that the reward is finite at any distance from the reference, in steps that end the episode and in other steps."""
    for batch, pay in _plain(config):
        e = batch.task.episodes[0]
        for distance in (0.0, 1e-9, float(e.distance), 1e4):
            e.distance = e.to_go = e.last_distance = distance
            for outcome in ("", *TASKS[batch.task.name].outcomes):
                e.outcome = OUTCOMES.index(outcome) if outcome else rows.GOES_ON
                paid = pay()
                if not np.isfinite(paid):
                    end = f"a step that ends the episode by {outcome}" if outcome else "a step on the way"
                    raise ConformanceError(
                        f"{end}, {distance:g} m from the reference, gives the reward {paid}; it must be finite"
                    )


def it_changes_nothing_that_it_reads(config: schema.TrainConfig) -> None:
    """Check that the reward does not change the episode, the vehicle or the parameters."""
    for batch, pay in _plain(config):
        task = batch.task
        read = {
            "the episode": task.episodes,
            "the parameters": task.prices,
            "the action": task.command,
            "the last action": task.previous,
            "the force": batch.simulator.command_force,
        }
        before = {name: value.tobytes() for name, value in read.items()}
        pay()
        for name, value in read.items():
            if value.tobytes() != before[name]:
                raise ConformanceError(f"it changes {name}")


def it_stays_within_its_arrays(config: schema.TrainConfig) -> None:
    """Check that the reward, run as Python, accesses only existing fields and indices, and gives the same value as its compiled form."""
    compiled, plain = Batch(config, 2, seed=3), Batch(config, 2, seed=3)
    plain.task.interpret()
    try:
        for batch in (compiled, plain):
            batch.reset()
        for step in range(3):
            action = actions(step, 2, len(plain.vehicle.actuators))
            by_compiled, by_python = (batch.step(action).reward.copy() for batch in (compiled, plain))
            if not np.allclose(by_compiled, by_python, rtol=1e-9, atol=1e-9):
                raise ConformanceError(
                    f"rewards must be the same compiled ({by_compiled.tolist()}) and as Python ({by_python.tolist()}): step {step}"
                )
    except (AgentError, IndexError) as error:
        raise ConformanceError(f"run as Python: {error}") from error


def _plain(config: schema.TrainConfig) -> Iterator[tuple[Batch, Callable[[], float]]]:
    """Yield environments after a few steps, with a function that returns the reward of the first environment's last step."""
    batch = Batch(config, 2, seed=3)
    batch.reset()
    function = getattr(function_of(config.reward), "py_func", function_of(config.reward))
    for step in range(2):
        batch.step(actions(step, 2, len(batch.vehicle.actuators)))
    task, simulator = batch.task, batch.simulator
    vehicle = rows.vehicle(
        0,
        simulator.pose,
        simulator.velocity,
        task.command,
        task.previous,
        simulator.command_force,
        simulator.power,
    )
    yield batch, lambda: float(function(task.episodes[0], vehicle, task.prices[0]))


REWARD_CHECKS: tuple[Callable[[schema.TrainConfig], None], ...] = (
    its_numbers_do_not_depend_on_the_batch,
    it_pays_every_end,
    it_changes_nothing_that_it_reads,
    it_stays_within_its_arrays,
)
"""Checks of every reward."""


def check_reward(*overrides: str, only: Callable[[Any], None] | None = None) -> None:
    """Check a reward against its contract (`auvbench.tasks.rewards`).

    Args:
        overrides: arguments of `auvbench train`: the reward, `reward=NAME`, and possibly a task and a vehicle.
        only: one of `REWARD_CHECKS`; default: all.

    Raises:
        ConformanceError: the reward breaks its contract.
        ConfigError: an override is wrong, or the reward does not suit the task.
    """
    config = train_config(compose("train", list(overrides)))
    run_checks(REWARD_CHECKS, only, overrides, lambda check: check(config))

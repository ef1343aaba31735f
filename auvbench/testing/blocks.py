"""Check blocks of observations."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.config import schema, tasks
from auvbench.config.compose import compose
from auvbench.config.validate import train_config
from auvbench.envs.batch import Batch
from auvbench.errors import AgentError
from auvbench.pilot import live_observation as observation
from auvbench.testing.draws import ConformanceError, actions, reseed_generators, run_checks, same, untouched

N, STEPS = 5, 20
"""Number of parallel episodes, and number of steps, of a check"""

ROUNDING = 1e-6
"""Relative and absolute tolerance between the numbers of a block's compiled form and Python form; the numbers are rounded to 32 bits"""


def play(batch: Batch, first: int = 0) -> NDArray[np.float32]:
    """Reset a batch and step it; return the observations (steps + 1, n, size)."""
    observations = [batch.reset().copy()]
    for step in range(STEPS):
        action = actions(step, batch.n, len(batch.vehicle.actuators), first)
        observations.append(batch.step(action).observation.copy())
    return np.array(observations)


def interpreted(config: schema.TrainConfig, n: int) -> Batch:
    """Return environments whose blocks run as Python."""
    batch = Batch(config, n, seed=3)
    batch.task.interpret()
    return batch


def its_numbers_are_finite_and_within_bounds(config: schema.TrainConfig) -> None:
    """Check that the block's numbers are finite and within the bounds that the block declares."""
    batch = Batch(config, N, seed=3)
    observations = play(batch)
    for name, block in batch.task.spec.blocks.items():
        most = np.asarray(block.bounds, dtype=np.float32)
        good = np.abs(observations[..., batch.task.spec[name]]) <= most
        if not good.all():
            step, row, column = np.argwhere(~good)[0]
            value = observations[step, row, batch.task.spec[name]][column]
            raise ConformanceError(
                f"{block.labels[column]}={value:g} after step {step}; it must be within [{-most[column]:g}, {most[column]:g}]"
            )


def its_numbers_do_not_depend_on_the_batch(config: schema.TrainConfig) -> None:
    """Check that an episode gives the same numbers in a batch of any size, and that no number is drawn from a global generator."""
    reseed_generators(1)
    with untouched("observing"):
        together = play(Batch(config, N, seed=3))
    reseed_generators(2)
    for row in (0, N - 1):
        alone = play(Batch(config, row + 1, seed=3))
        same(alone[:, row], together[:, row], f"the observations of row {row} in a batch of {row + 1}")


def it_stays_within_its_arrays(config: schema.TrainConfig) -> None:
    """Check that the block, run as Python, accesses only existing fields and indices, and writes the same numbers as its compiled form."""
    compiled = play(Batch(config, 2, seed=3))
    try:
        plain = play(interpreted(config, 2))
    except (AgentError, IndexError, ValueError) as error:
        raise ConformanceError(f"run as Python: {error}") from error
    if not np.allclose(plain, compiled, rtol=ROUNDING, atol=ROUNDING):
        raise ConformanceError(
            f"its compiled form and its Python form must give the same numbers; they differ by up to {np.abs(plain - compiled).max():.3g}"
        )


def it_changes_nothing_that_it_reads(config: schema.TrainConfig) -> None:
    """Check that the block writes only to its own numbers."""
    batch = interpreted(config, 2)
    play(batch)
    task, simulator = batch.task, batch.simulator
    read = {
        "the pose": simulator.pose,
        "the velocity": simulator.velocity,
        "the action": task.previous,
        "the preview": task.preview,
        "the episode": task.episodes,
        "the parameters": task.parameters,
    }
    before = {name: value.tobytes() for name, value in read.items()}
    task.observe(simulator.pose, simulator.velocity)
    for name, value in read.items():
        if value.tobytes() != before[name]:
            raise ConformanceError(f"it changes {name}")


def a_pilot_observes_it(config: schema.TrainConfig) -> None:
    """Check that a pilot observes finite numbers within the bounds.

    Skip observations with a history or with a block that a pilot cannot supply.
    """
    batch = Batch(config, 1, seed=3)
    spec, task = batch.task.spec, batch.task
    if not set(tasks.blocks(config.task)) <= set(observation.supplied()) or config.task.history > 1:
        return
    batch.reset()
    depth = (config.task.depth_low, config.task.depth_high)
    pose, velocity = batch.simulator.pose[0], batch.simulator.velocity[0]
    yaw = float(task.episodes[0].reference_yaw) if isinstance(config.task, tasks.Tracked) else None
    try:
        values = observation.observe(
            spec, pose, velocity, task.reference[0], task.previous[0], yaw=yaw, depth=depth
        )
    except Exception as error:
        raise ConformanceError(f"a pilot cannot call it: {type(error).__name__}: {error}") from error
    if not (np.abs(values) <= spec.bounds).all():
        raise ConformanceError(
            f"a pilot observes {values.tolist()}, beyond the bounds {spec.bounds.tolist()}"
        )


BLOCK_CHECKS: tuple[Callable[[schema.TrainConfig], None], ...] = (
    its_numbers_are_finite_and_within_bounds,
    its_numbers_do_not_depend_on_the_batch,
    it_stays_within_its_arrays,
    it_changes_nothing_that_it_reads,
    a_pilot_observes_it,
)
"""Checks of every block."""


def check_block(*overrides: str, only: Callable[[Any], None] | None = None) -> None:
    """Check blocks of an observation against their contract (`auvbench.blocks.BlockSpec`).

    Args:
        overrides: arguments of `auvbench train`: the blocks, `task.observation=[NAME,...]`, and possibly a task and a vehicle.
        only: one of `BLOCK_CHECKS`; default: all.

    Raises:
        ConformanceError: a block breaks its contract.
        ConfigError: an override is wrong, or the task cannot supply the block.
    """
    config = train_config(compose("train", list(overrides)))
    run_checks(BLOCK_CHECKS, only, overrides, lambda check: check(config))

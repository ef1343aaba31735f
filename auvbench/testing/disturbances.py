"""Check disturbances."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from auvbench.config import schema
from auvbench.config.compose import compose
from auvbench.config.validate import train_config
from auvbench.dynamics.layout import CURRENT
from auvbench.envs.batch import Batch
from auvbench.errors import AgentError
from auvbench.tasks.bounds import SIGMAS
from auvbench.tasks.disturbances.base import water_speed
from auvbench.testing.draws import ConformanceError, run_checks, same
from auvbench.testing.tasks import (
    STEPS,
    N,
    it_resumes_in_mid_episode,
    its_rows_do_not_depend_on_the_batch,
    play,
)


def it_changes_the_motion_or_the_readings(config: schema.TrainConfig) -> None:
    """Check that an environment with the disturbance gives other observations than an environment without it."""
    without = train_config(compose("train", ["algo=pid", "disturbance=none"])).disturbance
    observations = []
    for disturbance in (config.disturbance, without):
        batch = Batch(replace(config, disturbance=disturbance), N, seed=3)
        batch.reset()
        observations.append(play(batch, range(STEPS))[0]["observation"])
    if np.array_equal(observations[0], observations[1]):
        raise ConformanceError(
            f"in {STEPS} steps the observations are the same with and without the disturbance; it must change them"
        )


def its_draws_are_functions_of_their_key(config: schema.TrainConfig) -> None:
    """Check that an episode gives the same observations in a batch of any size and in any environment of the batch."""

    def observations(*episodes: int) -> Any:
        batch = Batch(config, len(episodes), seed=3, test=True, autoreset=False)
        batch.task.assign(np.array(episodes))
        batch.reset()
        action = np.full((len(episodes), len(batch.vehicle.actuators)), 0.3)
        return np.array([batch.step(action).observation.copy() for _ in range(STEPS)])

    same(
        observations(4)[:, 0],
        observations(7, 2, 4)[:, 2],
        "the observations of episode 4 must be the same alone and in a batch",
    )


def its_water_stays_within_its_bound(config: schema.TrainConfig) -> None:
    """Check that the current in the simulator is not faster than the bound that follows from `water_speed`."""
    batch = Batch(config, N, seed=3)
    batch.reset()
    play(batch, range(STEPS))
    if not hasattr(batch.simulator, "current"):
        return
    mean, spread = water_speed(config.disturbance, batch.vehicle)
    most = mean + SIGMAS * spread
    rows = batch.simulator.current.view(CURRENT)[:, 0]
    for velocity in (rows["velocity"], rows["velocity"] + rows["change"]):
        speed = float(np.linalg.norm(velocity, axis=1).max())
        if speed > most * (1.0 + 1e-9):
            raise ConformanceError(
                f"the current's speed is {speed:g} m/s; water_speed allows at most {most:g} m/s"
            )


def its_functions_stay_within_their_arrays(config: schema.TrainConfig) -> None:
    """Check that the disturbance's functions for one episode, run as Python, access only existing fields and indices."""
    batch = Batch(config, 2, seed=3)
    if batch.disturbances is None:
        raise ConformanceError(
            "the configuration has no active disturbance; choose one with disturbance=NAME"
        )
    batch.disturbances.interpret()
    try:
        batch.reset()
        play(batch, range(3))
    except (AgentError, IndexError) as error:
        raise ConformanceError(f"{error}; `fields` must declare each value that an episode stores") from error


DISTURBANCE_CHECKS: tuple[Callable[[schema.TrainConfig], None], ...] = (
    its_rows_do_not_depend_on_the_batch,
    it_resumes_in_mid_episode,
    its_draws_are_functions_of_their_key,
    it_changes_the_motion_or_the_readings,
    its_water_stays_within_its_bound,
    its_functions_stay_within_their_arrays,
)
"""Checks of every disturbance."""


def check_disturbance(*overrides: str, only: Callable[[schema.TrainConfig], None] | None = None) -> None:
    """Check a disturbance against its contract (`auvbench.tasks.disturbances.base.Disturbance`).

    Args:
        overrides: arguments of `auvbench train`: the disturbance, `disturbance=NAME`, and possibly a task and a
            vehicle.
        only: one of `DISTURBANCE_CHECKS`; default: all.

    Raises:
        ConformanceError: the disturbance breaks its contract.
        ConfigError: an override is wrong.
    """
    config = train_config(compose("train", list(overrides)))
    run_checks(DISTURBANCE_CHECKS, only, overrides, lambda check: check(config))

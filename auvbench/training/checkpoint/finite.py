"""Notices a NaN or an infinity when it appears, in the physics or in the networks, and stops the run.

A run that goes on with a NaN wastes its budget and would overwrite its last good checkpoint.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecNormalize

from auvbench.errors import ActionError, AuvbenchError, TrainingError


def check_step(
    observations: NDArray[Any], rewards: NDArray[Any], normalize: VecNormalize | None, step: int
) -> None:
    """Raises `TrainingError` when what the environments returned in this step is not finite.

    Args:
        observations: (n, d), as the learner sees them.
        rewards: (n,), as the learner sees them.
        normalize: the wrapper that made them; the values before it are looked at, since clipping hides an
            infinity.
        step: environment steps so far, for the message.
    """
    if normalize is not None:
        observations, rewards = np.asarray(normalize.old_obs), normalize.old_reward
    for what, values in (("observation", observations), ("reward", rewards)):
        fine = np.isfinite(values)
        if not fine.all():
            bad = ~fine
            environment = int(np.nonzero(bad)[0][0])
            value = values[bad][0]
            raise TrainingError(f"step {step}: the {what} of environment {environment} is {value}")


def check_losses(model: BaseAlgorithm) -> None:
    """Raises `TrainingError` when a number that the last update logged is not finite."""
    for key, value in model.logger.name_to_value.items():
        # explained_variance is NaN by definition where the returns do not vary.
        if key.startswith("train/") and key != "train/explained_variance" and not math.isfinite(value):
            raise TrainingError(f"step {model.num_timesteps}: {key} became {value}")


def check_parameters(model: BaseAlgorithm) -> None:
    """Raises `TrainingError` when a weight of the policy or of a target network is not finite."""
    bad = non_finite_parameter(model)
    if bad is not None:
        raise TrainingError(f"step {model.num_timesteps}: the weights {bad} of the policy are not finite")


@contextmanager
def diagnosed(model: BaseAlgorithm) -> Iterator[None]:
    """Names the weights as the cause of an error that they have caused.

    A NaN that appears within an update makes torch's distributions complain about their arguments in many
    lines before anybody could look at the weights.
    """
    try:
        yield
    except Exception as error:
        if isinstance(error, AuvbenchError) and not isinstance(error, ActionError):
            raise
        try:
            check_parameters(model)
        except TrainingError as cause:
            raise cause from error
        raise


def non_finite_parameter(model: BaseAlgorithm) -> str | None:
    """The name of the first parameter that holds a NaN or an infinity; None when all are finite."""
    with torch.no_grad():
        named = dict(model.policy.named_parameters())
        total = torch.stack([parameter.sum() for parameter in named.values()]).sum()
        if math.isfinite(float(total)):
            return None
        for name, parameter in named.items():
            if not bool(torch.isfinite(parameter).all()):
                return name
    return None

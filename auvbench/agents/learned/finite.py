"""Notices a NaN or an infinity in SB3's networks and losses when it appears, and stops the run.

A run that goes on with a NaN wastes its budget and would overwrite its last good checkpoint. The physics is watched
by the worker.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager

import torch
from stable_baselines3.common.base_class import BaseAlgorithm

from auvbench.errors import ActionError, AuvbenchError, TrainingError


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
    lines before the weights are checked.
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
    """The name of the first parameter, or running statistic, that is not finite; None when all are."""
    with torch.no_grad():
        named: dict[str, torch.Tensor] = dict(model.policy.named_parameters())
        named |= {n: buffer for n, buffer in model.policy.named_buffers() if buffer.is_floating_point()}
        total = torch.stack([parameter.sum() for parameter in named.values()]).sum()
        if math.isfinite(float(total)):
            return None
        for name, parameter in named.items():
            if not bool(torch.isfinite(parameter).all()):
                return name
    return None

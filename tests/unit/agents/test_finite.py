from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.logger import Logger

from auvbench.agents.learned import learners as finite
from auvbench.errors import TrainingError
from tests.soak.learning import CASES, train
from tests.soak.pendulum import Pendulums


@pytest.fixture
def model() -> BaseAlgorithm:
    torch.set_num_threads(1)
    model, _ = CASES["sac-1"].build(0)
    model.set_logger(Logger(None, []))
    return model


def test_losses_and_weights_are_named(model: BaseAlgorithm) -> None:
    finite.check_losses(model)
    finite.check_parameters(model)
    model.logger.record("train/explained_variance", float("nan"))  # by definition, where returns do not vary
    model.logger.record("rollout/ep_rew_mean", float("nan"))  # before the first episode has ended
    finite.check_losses(model)
    model.logger.record("train/actor_loss", np.float32("nan"))
    with pytest.raises(TrainingError, match="train/actor_loss became nan"):
        finite.check_losses(model)
    with torch.no_grad():
        model.policy.critic_target.qf0[0].weight[1, 1] = torch.inf  # type: ignore[union-attr,index,operator]
    with pytest.raises(TrainingError, match=r"weights critic_target\.qf0\.0\.weight"):
        finite.check_parameters(model)


def test_an_error_that_ill_weights_have_caused_is_blamed_on_them(model: BaseAlgorithm) -> None:
    with pytest.raises(ValueError, match="of its own"), finite.diagnosed(model):
        raise ValueError("of its own")
    with torch.no_grad():
        next(model.policy.parameters()).view(-1)[0] = torch.nan
    with pytest.raises(TrainingError, match="are not finite"), finite.diagnosed(model):
        raise ValueError("Expected parameter loc to satisfy the constraint Real()")


def test_a_checkpoint_of_ill_weights_is_never_written(tmp_path: Path) -> None:
    def watch(model: BaseAlgorithm, batch: Pendulums) -> None:
        batch.poison_at = 300

    with pytest.raises(TrainingError, match=r"step 304: the reward of environment 7 is nan"):
        train(tmp_path, CASES["sac-8"], watch=watch, every_steps=1)
    steps = sorted(int(path.name) for path in tmp_path.glob("checkpoints/[0-9]*"))
    assert steps[-1] < 304

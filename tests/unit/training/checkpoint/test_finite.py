from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.vec_env import VecNormalize

from auvbench.errors import TrainingError
from auvbench.training.checkpoint import finite
from tests.soak.learning import CASES, train
from tests.soak.pendulum import Pendulums


@pytest.fixture
def model() -> BaseAlgorithm:
    torch.set_num_threads(1)
    model, _ = CASES["sac-1"].build(0)
    model.set_logger(Logger(None, []))
    return model


def test_finite_steps_pass() -> None:
    finite.check_step(np.ones((4, 3), np.float32), np.ones(4, np.float32), None, 0)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_the_environment_is_named(value: float) -> None:
    observations, rewards = np.ones((4, 3), np.float32), np.ones(4, np.float32)
    observations[2, 1] = value
    with pytest.raises(TrainingError, match=rf"step 80: the observation of environment 2 is {value}"):
        finite.check_step(observations, rewards, None, 80)
    observations[2, 1], rewards[1] = 0.0, value
    with pytest.raises(TrainingError, match=rf"the reward of environment 1 is {value}"):
        finite.check_step(observations, rewards, None, 80)


def test_infinities_of_both_signs_do_not_cancel() -> None:
    rewards = np.array([np.inf, -np.inf, 1.0])
    with pytest.raises(TrainingError, match="environment 0 is inf"):
        finite.check_step(np.ones((3, 2)), rewards, None, 1)


def test_an_infinity_is_seen_behind_the_clipping_of_the_normaliser() -> None:
    normalize = VecNormalize(Pendulums(2))
    normalize.reset()
    normalize.old_obs[1, 0] = np.inf  # type: ignore[index,call-overload]
    normalize.old_reward = np.zeros(2)
    with pytest.raises(TrainingError, match="observation of environment 1 is inf"):
        finite.check_step(np.full((2, 3), 10.0), np.zeros(2), normalize, 5)


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

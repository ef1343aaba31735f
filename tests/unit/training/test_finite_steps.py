from __future__ import annotations

import numpy as np
import pytest

from auvbench.errors import TrainingError
from auvbench.training.learning import check_step


def test_finite_steps_pass() -> None:
    check_step(np.ones((4, 3), np.float32), np.ones(4, np.float32), 0)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_the_environment_is_named(value: float) -> None:
    observations, rewards = np.ones((4, 3), np.float32), np.ones(4, np.float32)
    observations[2, 1] = value
    with pytest.raises(TrainingError, match=rf"step 80: the observation of environment 2 is {value}"):
        check_step(observations, rewards, 80)
    observations[2, 1], rewards[1] = 0.0, value
    with pytest.raises(TrainingError, match=rf"the reward of environment 1 is {value}"):
        check_step(observations, rewards, 80)


def test_infinities_of_both_signs_do_not_cancel() -> None:
    rewards = np.array([np.inf, -np.inf, 1.0])
    with pytest.raises(TrainingError, match="environment 0 is inf"):
        check_step(np.ones((3, 2)), rewards, 1)

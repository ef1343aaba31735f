"""A learner that is stopped and built anew from its checkpoint goes on with the same bits."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from stable_baselines3.common.callbacks import BaseCallback

from tests.soak.learning import CASES, fingerprint, train


@pytest.fixture(autouse=True)
def one_thread() -> None:
    torch.set_num_threads(1)


class Crash(BaseCallback):
    """Raises in the middle of a step, after some steps of this process."""

    def __init__(self, after: int) -> None:
        super().__init__()
        self.after = after

    def _on_step(self) -> bool:
        if self.n_calls * self.training_env.num_envs >= self.after:
            raise RuntimeError("crash")
        return True


# The LSTM's state, the replay buffer and the noise are each in one of the quick ones.
QUICK = ("ppo-8", "td3-1", "recurrent_ppo-4")
# Statistics that normalise, several steps of gradients at once, and compiled updates; `make soak` and
# tests/integration/test_own_agents_conform.py stop every algorithm.
SLOW = ("crossq-8", "td3-8", "compiled-sac-8", "trpo-8")


@pytest.mark.parametrize("name", [*QUICK, *(pytest.param(name, marks=pytest.mark.slow) for name in SLOW)])
def test_crashes_do_not_change_a_bit(name: str, tmp_path: Path) -> None:
    case = CASES[name]
    model, batch, _ = train(tmp_path / "whole", case)
    expected = fingerprint(model, batch, tmp_path / "whole")
    run = tmp_path / "crashed"
    for _ in range(3):
        with pytest.raises(RuntimeError, match="crash"):
            train(run, case, callbacks=(Crash(case.steps // 4),), every_steps=40)
    model, batch, checkpointer = train(run, case, every_steps=70)
    assert checkpointer.resumed is not None
    assert checkpointer.resumed.step > 100
    assert fingerprint(model, batch, run) == expected

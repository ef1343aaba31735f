"""A simulator that cannot bring its state back: a resumed run begins its episodes in flight again."""

import numpy as np
import pytest
import torch

from auvbench.agents.learned import state
from auvbench.agents.learned.sb3 import Follower
from auvbench.config.simulators import Capabilities
from auvbench.envs.batch import Batch
from auvbench.errors import TrainingError
from auvbench.simulators.fossen import FossenSimulator
from auvbench.training.checkpoint.store import CheckpointStore
from auvbench.training.execute import execute
from tests import configs
from tests.soak.campaign import frozen

FORGETFUL = Capabilities(exact_resume=False, deterministic=True, scales=True, currents="sheared")


@pytest.fixture
def forgetful(monkeypatch):
    """The embedded simulator, as if it could not bring a state back."""
    monkeypatch.setattr(FossenSimulator, "capabilities", FORGETFUL)
    monkeypatch.setattr(FossenSimulator, "state_dict", lambda self: {})


def configuration(*overrides):
    return configs.training("disturbance=moderate", "algo=sac", "algo.n_envs=3", *overrides)


def test_episodes_in_flight_begin_again_with_the_same_draws(forgetful):
    config = configuration()
    batch = Batch(config)
    first = batch.reset().copy()
    scenario = batch.task.scenario()
    for _ in range(7):
        batch.step(np.full((3, 6), 0.3))
    assert not batch.exact_resume
    other = Batch(config)
    other.load_state_dict(batch.state_dict())
    assert np.array_equal(other.restarted, first)
    assert np.array_equal(other.task.scenario(), scenario)
    one, two = Batch(config), other
    one.reset()
    for _ in range(5):
        a, b = one.step(np.full((3, 6), 0.2)), two.step(np.full((3, 6), 0.2))
        assert np.array_equal(a.observation, b.observation)
        assert np.array_equal(a.reward, b.reward)


@pytest.mark.slow
@pytest.mark.parametrize("case", ["ppo-8", "sac-8", "ppo_residual-8", "recurrent_ppo-8"])
def test_a_run_goes_on_from_their_first_observations_and_its_manifest_says_so(
    forgetful, monkeypatch, tmp_path, case
):
    torch.set_num_threads(1)
    run = frozen(tmp_path, "tried", case, ["train.checkpoint.steps=200"])
    ordinary = Follower._on_step
    seen = []

    def on_step(self):
        if not seen and self.num_timesteps >= 500:
            seen.append(self.num_timesteps)
            raise RuntimeError("struck")
        return ordinary(self)

    monkeypatch.setattr(Follower, "_on_step", on_step)
    with pytest.raises(TrainingError, match="struck"):
        execute(run)
    saved = CheckpointStore(run.path).steps()[0]
    begun = []
    began = state._begin_episodes
    monkeypatch.setattr(
        state, "_begin_episodes", lambda *arguments: (begun.append(arguments[-1]), began(*arguments))
    )
    manifest = execute(run)
    assert manifest["state"] == "complete"
    assert manifest["episodes_begun_again"] == [saved]
    assert len(begun) == 1
    assert begun[0].shape[0] == 8

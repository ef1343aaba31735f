"""BenchMARL: MAPPO trains a team of three, with `state()` for its critic, and is evaluated."""

import math
import tempfile
from importlib.metadata import version

from benchmarl.algorithms import MappoConfig
from benchmarl.environments.pettingzoo.common import PettingZooClass
from benchmarl.experiment import Callback, Experiment, ExperimentConfig
from benchmarl.models.mlp import MlpConfig
from pettingzoo.utils import BaseParallelWrapper
from torchrl.envs import PettingZooWrapper

import auvbench

BATCH, TOTAL, STATE = 600, 3000, 19 * 3
STEPS = 50
"""steps of an episode"""


class WithoutRecord(BaseParallelWrapper):
    """A team without `info["record"]`: TorchRL takes only the keys that `info` has at a reset."""

    def step(self, actions):
        *result, infos = super().step(actions)
        for info in infos.values():
            info.pop("record", None)
        return *result, infos


class Formation(PettingZooClass):
    """The task of BenchMARL for one of our team environments."""

    def get_env_fun(self, num_envs, continuous_actions, seed, device):
        team = {"vehicles": 3, "vehicle": "bluerov2_heavy", "overrides": [f"task.time_limit={STEPS / 10}"]}

        def make():
            env = WithoutRecord(auvbench.parallel_env("auvbench/Formation-v0", **team))
            return PettingZooWrapper(env, return_state=self.has_state(), device=device, seed=seed)

        return make

    def supports_continuous_actions(self):
        return True

    def supports_discrete_actions(self):
        return False

    def has_state(self):
        return True

    def has_render(self, env):
        return False

    def max_steps(self, env):
        return STEPS


class Watch(Callback):
    """Check what MAPPO gets and learns from."""

    def __init__(self):
        super().__init__()
        self.steps, self.rewards, self.critic = 0, [], None

    def on_batch_collected(self, batch):
        reward, state = batch["next", "vehicle", "reward"], batch["state"]
        assert reward.shape[-2:] == (3, 1)
        assert state.shape[-1] == STATE
        assert reward.isfinite().all()
        assert state.isfinite().all()
        assert batch["next", "done"].any()
        self.steps += batch.numel()
        self.rewards.append(reward.mean().item())

    def on_train_end(self, training, group):
        assert all(math.isfinite(training[name].mean()) for name in ("loss_objective", "loss_critic"))


with tempfile.TemporaryDirectory() as folder:
    config = ExperimentConfig.get_from_yaml()
    config.max_n_frames, config.lr = TOTAL, 3e-4
    config.on_policy_collected_frames_per_batch, config.on_policy_n_envs_per_worker = BATCH, 4
    config.on_policy_minibatch_size, config.on_policy_n_minibatch_iters = 150, 3
    config.evaluation_interval, config.evaluation_episodes = BATCH * 5, 2
    config.loggers, config.create_json, config.save_folder = ["csv"], False, folder
    watch = Watch()
    experiment = Experiment(
        task=Formation("FORMATION", {}),
        algorithm_config=MappoConfig.get_from_yaml(),
        model_config=MlpConfig.get_from_yaml(),
        seed=0,
        config=config,
        callbacks=[watch],
    )
    before = [p.clone() for p in experiment.policy.parameters()]
    experiment.run()
    assert experiment.total_frames == watch.steps == TOTAL
    assert all(map(math.isfinite, [*watch.rewards, experiment.mean_return]))
    assert any((a != b).any() for a, b in zip(before, experiment.policy.parameters(), strict=True))
print("trained", watch.steps, "steps; BenchMARL", version("benchmarl"))

"""skrl: PPO on the batch."""

import tempfile

import gymnasium as gym
import skrl
import torch
from skrl.agents.torch.ppo import PPO, PPO_CFG
from skrl.envs.wrappers.torch import wrap_env
from skrl.memories.torch import RandomMemory
from skrl.models.torch import DeterministicMixin, GaussianMixin, Model
from skrl.trainers.torch import SequentialTrainer
from torch import nn

import auvbench

assert auvbench.__version__


class Policy(GaussianMixin, Model):
    def __init__(self, **spaces):
        Model.__init__(self, **spaces)
        GaussianMixin.__init__(self)
        self.net = nn.Sequential(nn.Linear(10, 32), nn.Tanh(), nn.Linear(32, 6))
        self.log_std = nn.Parameter(torch.zeros(6))

    def compute(self, inputs, role):
        return self.net(inputs["observations"]), {"log_std": self.log_std}


class Value(DeterministicMixin, Model):
    def __init__(self, **spaces):
        Model.__init__(self, **spaces)
        DeterministicMixin.__init__(self)
        self.net = nn.Sequential(nn.Linear(10, 32), nn.Tanh(), nn.Linear(32, 1))

    def compute(self, inputs, role):
        return self.net(inputs["observations"]), {}


env = wrap_env(gym.make_vec("auvbench/Waypoint-v1", num_envs=4, max_episode_steps=40))
spaces = {
    "observation_space": env.observation_space,
    "state_space": env.state_space,
    "action_space": env.action_space,
    "device": env.device,
}
config = PPO_CFG(rollouts=32, learning_epochs=2, mini_batches=2)
config.experiment.directory = tempfile.mkdtemp()
config.experiment.write_interval = config.experiment.checkpoint_interval = 0
agent = PPO(
    models={"policy": Policy(**spaces), "value": Value(**spaces)},
    memory=RandomMemory(memory_size=32, num_envs=env.num_envs, device=env.device),
    cfg=config,
    **spaces,
)
before = agent.policy.net[0].weight.detach().clone()
SequentialTrainer(cfg={"timesteps": 128, "headless": True}, env=env, agents=agent).train()
assert not torch.equal(before, agent.policy.net[0].weight)
print("trained 512 steps; skrl", skrl.__version__)

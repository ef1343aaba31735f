"""TorchRL: specs, a collector and some updates of a policy; then the vector environment."""

import gymnasium as gym
import torch
import torchrl
from tensordict.nn import TensorDictModule
from torch import nn
from torchrl.collectors import Collector
from torchrl.envs import Compose, DoubleToFloat, GymEnv, GymWrapper, RewardSum, StepCounter, TransformedEnv
from torchrl.envs.utils import check_env_specs

import auvbench

assert auvbench.__version__
ID = "auvbench/Waypoint-v1"
check_env_specs(GymEnv(ID))
env = TransformedEnv(GymEnv(ID, frequency=25), Compose(DoubleToFloat(), StepCounter(50), RewardSum()))
check_env_specs(env)
policy = TensorDictModule(
    nn.Sequential(nn.Linear(10, 32), nn.Tanh(), nn.Linear(32, 6), nn.Tanh()), ["observation"], ["action"]
)
optimizer = torch.optim.Adam(policy.parameters())
collected = 0
for data in Collector(env, policy, frames_per_batch=100, total_frames=400):
    collected += data.numel()
    loss = (policy(data.clone())["action"] ** 2).mean() - data["next", "reward"].mean()
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()
vector = gym.make_vec(ID, num_envs=4, max_episode_steps=20, autoreset_mode="SAME_STEP")
data = GymWrapper(vector).rollout(60, break_when_any_done=False)
assert data.batch_size == torch.Size([4, 60])
assert data["next", "done"].sum() >= 4
print("trained", collected, "steps; TorchRL", torchrl.__version__)

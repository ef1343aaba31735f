"""A script in the manner of CleanRL's ppo_continuous_action.py, with its wrappers and its --capture-video."""

import sys
import tempfile
from pathlib import Path

import gymnasium as gym
import numpy as np
import torch
from torch import nn
from torch.distributions.normal import Normal

ID, N, STEPS, UPDATES = "auvbench:auvbench/Waypoint-v1", 2, 128, 4


def make_env(index: int, folder: str):
    def thunk():
        if index == 0:
            env = gym.make(ID, render_mode="rgb_array", max_episode_steps=40)
            env = gym.wrappers.RecordVideo(env, folder, episode_trigger=lambda episode: episode == 0)
        else:
            env = gym.make(ID, max_episode_steps=40)
        env = gym.wrappers.FlattenObservation(env)
        env = gym.wrappers.RecordEpisodeStatistics(env)
        env = gym.wrappers.ClipAction(env)
        env = gym.wrappers.NormalizeObservation(env)
        env = gym.wrappers.TransformObservation(env, lambda o: np.clip(o, -10, 10), env.observation_space)
        env = gym.wrappers.NormalizeReward(env, gamma=0.99)
        return gym.wrappers.TransformReward(env, lambda reward: float(np.clip(reward, -10, 10)))

    return thunk


class Agent(nn.Module):
    def __init__(self, envs):
        super().__init__()
        n_o, n_u = np.prod(envs.single_observation_space.shape), np.prod(envs.single_action_space.shape)
        self.critic = nn.Sequential(nn.Linear(n_o, 64), nn.Tanh(), nn.Linear(64, 1))
        self.mean = nn.Sequential(nn.Linear(n_o, 64), nn.Tanh(), nn.Linear(64, n_u))
        self.logstd = nn.Parameter(torch.zeros(1, n_u))

    def forward(self, x, action=None):
        mean = self.mean(x)
        normal = Normal(mean, self.logstd.expand_as(mean).exp())
        action = normal.sample() if action is None else action
        return action, normal.log_prob(action).sum(1), self.critic(x).flatten()


with tempfile.TemporaryDirectory() as folder:
    envs = gym.vector.SyncVectorEnv([make_env(i, folder) for i in range(N)])
    agent = Agent(envs)
    optimizer = torch.optim.Adam(agent.parameters(), lr=3e-4, eps=1e-5)
    observation, _ = envs.reset(seed=1)
    episodes = 0
    for _ in range(UPDATES):
        kept = []
        for _ in range(STEPS):
            x = torch.as_tensor(observation, dtype=torch.float32)
            with torch.no_grad():
                action, logprob, value = agent(x)
            observation, reward, terminated, truncated, info = envs.step(action.numpy())
            done = terminated | truncated
            episodes += int(done.sum())
            kept.append((x, action, logprob, value, torch.as_tensor(reward), torch.as_tensor(done)))
        x, action, logprob, value, reward, done = (torch.stack(part) for part in zip(*kept, strict=True))
        advantage, last = torch.zeros_like(reward), 0.0
        for t in reversed(range(STEPS - 1)):
            alive = 1.0 - done[t].double()
            delta = reward[t] + 0.99 * value[t + 1] * alive - value[t]
            advantage[t] = last = delta + 0.99 * 0.95 * alive * last
        returns = (advantage + value).float()
        for _ in range(2):
            _, new, estimate = agent(x.flatten(0, 1), action.flatten(0, 1))
            ratio = (new - logprob.flatten()).exp()
            a = advantage.flatten().float()
            loss = torch.max(-a * ratio, -a * ratio.clamp(0.8, 1.2)).mean()
            loss = loss + 0.5 * (estimate - returns.flatten()).pow(2).mean()
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(agent.parameters(), 0.5)
            optimizer.step()
    envs.close()
    assert np.isfinite(float(loss.detach()))
    assert episodes > 0
    films = list(Path(folder).glob("*.mp4"))
    assert films
    assert films[0].stat().st_size > 1000, "the film of the first episode"

# The batch itself, in the way that later scripts of CleanRL step it.
envs = gym.make_vec("auvbench:auvbench/Waypoint-v1", num_envs=4, max_episode_steps=20)
envs = gym.wrappers.vector.RecordEpisodeStatistics(envs)
envs.reset(seed=1)
finished = 0
for _ in range(45):
    *_, info = envs.step(envs.action_space.sample())
    finished += int(info["_episode"].sum()) if "_episode" in info else 0
assert finished == 8, finished
print("trained", N * STEPS * UPDATES, "steps; Gymnasium", gym.__version__, file=sys.stdout)

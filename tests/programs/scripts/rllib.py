"""RLlib: PPO of its new API stack on the batch, through Gymnasium's `make_vec`."""

import os

os.environ["RAY_AUTH_MODE"] = "disabled"

import gymnasium as gym
import ray
from ray.rllib.algorithms.ppo import PPOConfig

import auvbench

assert auvbench.__version__
ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
config = (
    PPOConfig()
    .environment(
        "auvbench/Waypoint-v1", env_config={"k": 40, "overrides": "task.max_steps=40 task.goal_radius=0.01"}
    )
    .env_runners(
        num_env_runners=0,
        num_envs_per_env_runner=4,
        gym_env_vectorize_mode=gym.VectorizeMode.VECTOR_ENTRY_POINT,
    )
    .training(train_batch_size=400, minibatch_size=100, num_epochs=1)
)
algorithm = config.build_algo()
try:
    for _ in range(2):
        result = algorithm.train()
    # Its statistics count a step too many, of any environment; the episodes themselves are whole.
    episodes = [
        e for _ in range(2) for e in algorithm.env_runner.sample(num_timesteps=400, random_actions=True)
    ]
    ended = [e.t_started + len(e) for e in episodes if e.is_done]
    assert ended
    assert set(ended) == {40}, ended
finally:
    algorithm.stop()
    ray.shutdown()
runners = result["env_runners"]
assert runners["num_env_steps_sampled_lifetime"] >= 800
print("trained", int(runners["num_env_steps_sampled_lifetime"]), "steps; Ray", ray.__version__)

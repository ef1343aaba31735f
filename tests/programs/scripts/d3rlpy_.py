"""d3rlpy: SAC online, then offline on what it saw."""

import d3rlpy
import gymnasium as gym

import auvbench

assert auvbench.__version__
env = gym.make("auvbench/Waypoint-v1", max_episode_steps=100)
buffer = d3rlpy.dataset.create_fifo_replay_buffer(limit=5000, env=env)
sac = d3rlpy.algos.SACConfig(batch_size=32).create(device="cpu")
quiet = {"logger_adapter": d3rlpy.logging.NoopAdapterFactory()}
sac.fit_online(env, buffer, n_steps=600, n_steps_per_epoch=300, update_start_step=100, **quiet)
assert len(buffer.episodes) > 0
cql = d3rlpy.algos.CQLConfig(batch_size=32).create(device="cpu")
cql.fit(buffer, n_steps=50, n_steps_per_epoch=50, **quiet)
print("trained 600 steps; d3rlpy", d3rlpy.__version__)

"""Minari: a data set of a random policy's episodes, with what `info` says."""

import os
import tempfile

os.environ["MINARI_DATASETS_PATH"] = tempfile.mkdtemp()

import gymnasium as gym
import minari
import numpy as np

import auvbench

assert auvbench.__version__
env = minari.DataCollector(gym.make("auvbench/Waypoint-v1", max_episode_steps=60), record_infos=True)
steps = 0
for seed in range(5):
    env.reset(seed=seed)
    over = False
    while not over:
        _, _, terminated, truncated, _ = env.step(env.action_space.sample())
        over, steps = terminated or truncated, steps + 1
data = env.create_dataset(dataset_id="auvbench/waypoint/random-v0", algorithm_name="random")
assert data.total_steps == steps
again = minari.load_dataset("auvbench/waypoint/random-v0")
episode = next(again.iterate_episodes())
assert episode.observations.shape[1] == 10
assert np.asarray(episode.infos["waypoint"]).shape[1] == 3
assert again.recover_environment().spec.id == "auvbench/Waypoint-v1"
print("recorded", steps, "steps; Minari", minari.__version__)

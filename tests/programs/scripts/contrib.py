"""sb3-contrib: TQC on the batch, TRPO on Gymnasium's single environments, saved and loaded."""

import tempfile
from pathlib import Path

import sb3_contrib
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

from auvbench.envs import sb3

env = VecMonitor(VecNormalize(sb3.make(4, k=40, frequency=25, overrides="task.max_steps=50")))
model = sb3_contrib.TQC("MlpPolicy", env, learning_starts=100, batch_size=32, seed=1)
model.learn(600)
assert model.ep_info_buffer, "episodes ended"

env = make_vec_env(
    "auvbench/Waypoint-K40-25Hz-v0", n_envs=2, env_kwargs={"overrides": "task.max_steps=50"}, seed=1
)
model = sb3_contrib.TRPO("MlpPolicy", env, n_steps=128, seed=1)
model.learn(512)
with tempfile.TemporaryDirectory() as folder:
    model.save(Path(folder) / "model")
    sb3_contrib.TRPO.load(Path(folder) / "model", env=env).learn(256)
print("trained", 600 + 512 + 256, "steps; sb3-contrib", sb3_contrib.__version__)

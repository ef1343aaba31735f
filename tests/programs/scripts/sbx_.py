"""SBX: SAC and PPO in JAX, on the batch."""

import sbx

from auvbench.envs import sb3

env = sb3.make(4, overrides="task.max_steps=50")
model = sbx.SAC("MlpPolicy", env, learning_starts=100, batch_size=32, seed=1)
model.learn(400)
assert model.ep_info_buffer
sbx.PPO("MlpPolicy", env, n_steps=64, batch_size=64, seed=1).learn(512)
print("trained 912 steps; SBX", sbx.__version__)

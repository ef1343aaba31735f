"""A small deterministic batch of pendulums behind SB3's VecEnv, to test checkpoints without the simulator."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.vec_env import VecEnv


class Pendulums(VecEnv):
    """N pendulums; episodes last `steps` steps or end when the pendulum spins too fast."""

    def __init__(self, n: int, seed: int = 0, steps: int = 20) -> None:
        super().__init__(
            n, spaces.Box(-np.inf, np.inf, (3,), np.float32), spaces.Box(-1.0, 1.0, (2,), np.float32)
        )
        self.generator = np.random.default_rng(seed)
        self.steps = steps
        self.angle, self.rate = np.zeros(n), np.zeros(n)
        self.count, self.total = np.zeros(n, np.int64), np.zeros(n)
        self.poison_at: int | None = None
        self.done_steps = 0

    def state_dict(self) -> dict[str, np.ndarray]:
        words = self.generator.bit_generator.state["state"]
        generator = np.array([words["state"] >> 64, words["state"] & (2**64 - 1)], np.uint64)
        return {
            "angle": self.angle.copy(), "rate": self.rate.copy(), "count": self.count.copy(),
            "total": self.total.copy(), "generator": generator, "done_steps": np.asarray(self.done_steps),
        }  # fmt: skip

    def load_state_dict(self, state: dict[str, np.ndarray]) -> None:
        for name in ("angle", "rate", "count", "total"):
            getattr(self, name)[:] = state[name]
        high, low = (int(word) for word in state["generator"])
        full = self.generator.bit_generator.state
        full["state"]["state"] = (high << 64) | low
        self.generator.bit_generator.state = full
        self.done_steps = int(state["done_steps"])

    def observe(self) -> np.ndarray:
        return np.stack([np.cos(self.angle), np.sin(self.angle), self.rate], 1).astype(np.float32)

    def begin(self, which: np.ndarray) -> None:
        count = int(which.sum())
        self.angle[which] = self.generator.uniform(-1, 1, count)
        self.rate[which] = self.generator.uniform(-1, 1, count)
        self.count[which], self.total[which] = 0, 0.0

    def reset(self) -> np.ndarray:
        self.begin(np.ones(self.num_envs, bool))
        return self.observe()

    def step_async(self, actions: np.ndarray) -> None:
        self.actions = np.asarray(actions, np.float64)

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        self.rate += 0.1 * (3.0 * np.sin(self.angle) + 4.0 * self.actions.sum(1))
        self.angle += 0.1 * self.rate
        rewards = -(self.angle**2) - 0.1 * self.rate**2
        self.done_steps += self.num_envs
        if self.poison_at is not None and self.done_steps >= self.poison_at:
            rewards[-1] = np.nan
        self.count += 1
        self.total += rewards
        fast = np.abs(self.rate) > 3.0
        done = fast | (self.count >= self.steps)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        observations = self.observe()
        for i in np.nonzero(done)[0]:
            infos[i] = {
                "terminal_observation": observations[i].copy(), "TimeLimit.truncated": not fast[i],
                "episode": {"r": float(self.total[i]), "l": int(self.count[i])}, "is_success": bool(not fast[i]),
            }  # fmt: skip
        if done.any():
            self.begin(done)
            observations = self.observe()
        self.transition = (observations, rewards)
        return observations, rewards.astype(np.float32), done, infos

    def close(self) -> None: ...
    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        return [getattr(self, attr_name, None)] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        setattr(self, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        raise NotImplementedError(method_name)

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        return [False] * self.num_envs

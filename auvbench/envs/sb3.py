"""Stable-Baselines3's interface to the batch: a `VecEnv`."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvObs, VecEnvStepReturn

from auvbench.config.schema import step_limit
from auvbench.envs import info, rendering, settings
from auvbench.envs.batch import Batch, Transition
from auvbench.errors import ConfigError


def make(
    n_envs: int = 1, *, seed: int | None = None, render_mode: str | None = None, **kwargs: Any
) -> AuvVecEnv:
    """Return N environments for Stable-Baselines3's learners.

    Args:
        n_envs: number of environments in the batch; for a learner, each vehicle of a team is a separate environment.
        seed: seed of all draws; environment i draws from (seed, i). None: the configuration's seed.
        render_mode: see `AuvEnv`.
        kwargs: `overrides`, `config`, `conf` and the keywords of `settings.KEYS`; see `AuvEnv`.

    Raises:
        ConfigError: a setting is wrong.

    >>> from auvbench.envs import sb3
    >>> env = sb3.make(8, k=40, frequency=25)
    >>> env.reset().shape
    (8, 10)
    """
    if n_envs < 1:
        raise ConfigError(f"n_envs={n_envs}: must be at least 1")
    config = settings.configuration(**kwargs)
    number = None if seed is None else settings.folded(seed)
    return AuvVecEnv(Batch(config, n_envs, seed=number), render_mode=render_mode)


class AuvVecEnv(VecEnv):
    """Environments of a `Batch` for SB3's learners. As these learners expect, the step that ends an episode also begins the
    next episode.

    Args:
        batch: batch with automatic reset.
        detailed: whether every environment has an `info` at every step (`auvbench.envs.info`). If not, only
            environments whose episode ended have an `info`, which is enough for SB3's learners.
        render_mode: see `AuvEnv`.

    `transition` is the result of the last step.
    """

    def __init__(self, batch: Batch, *, detailed: bool = True, render_mode: str | None = None) -> None:
        self.batch = batch
        self.transition: Transition | None = None
        self.render_mode = render_mode
        self.metadata: dict[str, Any] = {
            "render_modes": list(rendering.MODES),
            "render_fps": rendering.speed(batch.config.step.frequency),
        }
        self._detailed = detailed
        self._renderer = rendering.Renderer(render_mode, batch)
        self._actions: NDArray[np.float32] | None = None
        self._begun = False
        observation_space, action_space = settings.spaces_of(batch)
        super().__init__(batch.n, observation_space, action_space)

    @property
    def spec(self) -> Any:
        """Return the specification of Gymnasium's id `auvbench.ID`, with this configuration's limit of steps."""
        import auvbench

        auvbench.register()
        spec = copy.deepcopy(gymnasium.spec(auvbench.ID))
        spec.max_episode_steps = step_limit(self.batch.config.task, self.batch.config.step.frequency)
        return spec

    def reset(self) -> VecEnvObs:
        places = self._places()
        if self._seeds[0] is not None:
            self.batch.reseed(settings.folded(self._seeds[0]))
        self._reset_seeds()
        self._reset_options()
        observation = self.batch.reset(**places).copy()
        self._begun = True
        self._renderer.begin(np.arange(self.num_envs))
        if self._detailed:
            state = self.batch.state
            self.reset_infos = [info.single(state, i) for i in range(self.num_envs)]
        return observation

    def _places(self) -> dict[str, Any]:
        checked = [settings.check_options(options) for options in self._options]
        names = checked[0].keys()
        if any(options.keys() != names for options in checked):
            raise ConfigError("options: must have the same names for every environment")
        rows = {name: [options[name] for options in checked] for name in names}
        bounds = self.batch.position_bounds
        return settings.places(rows, self.num_envs, self.batch.config.task, bounds)

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Set the seed for the next `reset`: environment i then draws from (seed, i)."""
        if seed is not None:
            self._seeds = [seed] * self.num_envs
        return self._seeds

    def step_async(self, actions: NDArray[np.float32]) -> None:
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        if not self._begun:
            raise ResetNeeded("no episode is under way: call reset() before step()")
        if self._actions is None:
            raise ResetNeeded("there are no actions: call step_async() before step_wait()")
        result = self.batch.step(self._actions)
        self.transition = result
        if self.render_mode is not None:
            self._renderer.follow_step(result, result.ended[:0])
            self._renderer.begin(result.ended)
        done = result.terminated | result.truncated
        return result.observation.copy(), result.reward.astype(np.float32), done, self._infos(result)

    def _infos(self, result: Transition) -> list[dict[str, Any]]:
        if self._detailed:
            state = self.batch.state
            infos = [info.single(state, i) for i in range(self.num_envs)]
        else:
            infos = [{} for _ in range(self.num_envs)]
        for k, (i, observation, record) in enumerate(
            zip(result.ended.tolist(), result.final_observation, result.records, strict=True)
        ):
            infos[i] = info.single(result.final_state, k, record) | {
                "terminal_observation": observation,
                "TimeLimit.truncated": bool(result.truncated[i]),
                "episode": {"r": record["return"], "l": record["steps"]},
            }
        return infos

    def close(self) -> None:
        pass

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        return [getattr(self, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        setattr(self, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list[Any]:
        result = getattr(self.batch, method_name)(*method_args, **method_kwargs)
        return [result] * len(list(self._get_indices(indices)))

    def env_is_wrapped(
        self, wrapper_class: type[gymnasium.Wrapper[Any, Any, Any, Any]], indices: VecEnvIndices = None
    ) -> list[bool]:
        return [False] * len(list(self._get_indices(indices)))

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        if self.render_mode != "rgb_array" or not self._begun:
            return [None] * self.num_envs
        return [self._renderer.show(i) for i in range(self.num_envs)]


WaypointVecEnv = AuvVecEnv
"""Earlier name of `AuvVecEnv`."""

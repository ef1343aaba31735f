"""Gymnasium's interface to one environment: `gymnasium.make("auvbench/Waypoint-v1")`."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from auvbench.config import schema
from auvbench.config.schema import step_limit
from auvbench.envs import info, rendering, settings
from auvbench.envs.batch import Batch
from auvbench.errors import ActionError, AuvbenchWarning

Observation = NDArray[np.float32]

_FIRST = np.zeros(1, dtype=np.int64)


class AuvEnv(gymnasium.Env[Observation, NDArray[np.float32]]):
    """One vehicle and its task: `auvbench/Waypoint-v1`, `auvbench/Docking-v1` and the other ids of single vehicles.

    Args:
        overrides: overrides as on the command line, e.g. `["reward.k=40", "vehicle=rexrov"]`, or one string with
            spaces between them.
        config: complete configuration, instead of overrides and keywords.
        render_mode: None, `rgb_array` (a picture (352, 832, 3) of the episode so far) or `ansi` (a line of text).
        conf: folder with your own configuration files, which is searched first.
        keywords: `task`, `vehicle`, `k`, `frequency` (Hz), `noise`, `disturbance` and the other keys of
            `settings.KEYS`: short forms of overrides.

    With the same seed and actions, this environment and environment 0 of `AuvVectorEnv` give bit-identical floats.
    `auvbench.envs.info` describes `info`.

    Raises:
        ConfigError: a setting is wrong.

    >>> import gymnasium
    >>> env = gymnasium.make("auvbench/Waypoint-v1", frequency=25)
    >>> observation, info = env.reset(seed=1)
    >>> observation.shape, info["waypoint"].round(1)
    ((19,), array([-14.6, -12.9, -16.6]))
    """

    metadata = {"render_modes": list(rendering.MODES), "render_fps": 10}  # noqa: RUF012

    def __init__(
        self,
        overrides: settings.Overrides = (),
        config: schema.TrainConfig | None = None,
        *,
        render_mode: str | None = None,
        conf: str | Path | None = None,
        **keywords: Any,
    ) -> None:
        self.config = settings.configuration(config, overrides, conf, **keywords)
        settings.refuse_team(self.config)
        self.batch = Batch(self.config, 1, autoreset=False)
        self.observation_space, self.action_space = settings.spaces_of(self.batch)  # type: ignore[assignment]
        self.render_mode = render_mode
        self.metadata = type(self).metadata | {"render_fps": rendering.speed(self.config.step.frequency)}
        self._renderer = rendering.Renderer(render_mode, self.batch)
        self._seeded = False
        self._under_way = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode: episode 0 of `seed`; without a seed, the next episode.

        Args:
            seed: whole number of any size; seeds of 2^32 and more are hashed to 32 bits.
            options: `pose` replaces the drawn start; `waypoint` or `distance` replaces the drawn goal. See
                `auvbench.envs.settings.places`.

        Raises:
            ConfigError: the seed or an option is wrong.
        """
        places = settings.places(
            settings.check_options(options), 1, self.config.task, self.batch.position_bounds
        )
        number = None if seed is None else settings.folded(seed)
        super().reset(seed=seed)
        self._warn_of_a_limit()
        if number is not None or not self._seeded:
            self.batch.reseed(number if number is not None else int(self.np_random.integers(1 << 32)))
            self._seeded = True
        observation = self.batch.reset(**places)
        self._under_way = True
        self._renderer.begin(_FIRST)
        return observation[0].copy(), info.single(self.batch.state, 0)

    def _warn_of_a_limit(self) -> None:
        """Warn that Gymnasium's limit of steps has cut an episode short."""
        steps = step_limit(self.config.task, self.config.step.frequency)
        if self._under_way and self.batch.task.episodes[0].steps == settings.STEPS < steps:
            warnings.warn(
                f"an episode was cut short after {settings.STEPS} steps, though the task allows {steps}: "
                f"use gymnasium.make(..., max_episode_steps={steps})",
                AuvbenchWarning,
                stacklevel=3,
            )

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Advance by one agent step of 1/frequency seconds with an action (n_u,), clipped to [-1, 1].

        Raises:
            ResetNeeded: no episode is under way.
            ActionError: the action has a wrong shape, a NaN or an infinity.
        """
        if not self._under_way:
            raise ResetNeeded("no episode is under way: call reset() before step()")
        values = np.asarray(action)
        if values.shape != self.action_space.shape:
            raise ActionError(f"an action of shape {values.shape}: must be {self.action_space.shape}")
        result = self.batch.step(values[None])
        record = result.records[0] if result.records else None
        self._under_way = record is None
        state = self.batch.state
        if self.render_mode is not None:
            outcome = None if record is None else str(record["outcome"])
            self._renderer.follow(0, state.pose[0], state.distance[0], state.force[0], outcome)
        return (
            result.observation[0].copy(),
            float(result.reward[0]),
            bool(result.terminated[0]),
            bool(result.truncated[0]),
            info.single(state, 0, record),
        )

    def render(self) -> Any:
        """Return the present picture or line of the episode; None without a `render_mode`.

        Raises:
            ResetNeeded: no episode has begun.
        """
        if not self._seeded:
            raise ResetNeeded("there is nothing to show: call reset() before render()")
        return self._renderer.show(0)


WaypointEnv = AuvEnv
"""Earlier name of `AuvEnv`."""

"""Gymnasium's vector interface to a batch: `gymnasium.make_vec("auvbench/Waypoint-v1", num_envs=1024)`."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector import VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from auvbench.config import schema
from auvbench.envs import info, rendering, settings
from auvbench.envs.batch import Batch, Transition
from auvbench.errors import ConfigError, closest

if TYPE_CHECKING:
    from gymnasium.vector import AutoresetMode
else:
    try:
        from gymnasium.vector import AutoresetMode
    except ImportError:  # Gymnasium 1.0

        class AutoresetMode(Enum):
            """As in Gymnasium 1.1."""

            NEXT_STEP = "NextStep"
            SAME_STEP = "SameStep"
            DISABLED = "Disabled"


Arrays = NDArray[Any]


class AuvVectorEnv(VectorEnv[Arrays, Arrays, Arrays]):
    """N environments in one batch.

    Args:
        num_envs: number of environments.
        overrides: see `AuvEnv`.
        config: complete configuration, instead of overrides and keywords.
        autoreset_mode: when the next episode of an environment begins. `NEXT_STEP`, as in Gymnasium's own vector
            environments: in the next step, whose action is ignored and whose reward is 0. `SAME_STEP`: in the step
            that ends an episode; `info["final_obs"]` then has the last observation of the ended episode, and
            `info["final_info"]` its last info. `DISABLED`: only by `reset(options={"reset_mask": ...})`.
        max_episode_steps: limit that replaces `task.max_steps`; 1000, which Gymnasium passes by default, changes
            nothing, and -1 sets the limit to 10 million steps.
        render_mode: see `AuvEnv`; `render` returns one picture or line per environment.
        conf: folder with your own configuration files, which is searched first.
        keywords: `task`, `vehicle`, `k`, `frequency` (Hz), `noise`, `disturbance` and the other keys of
            `settings.KEYS`: short forms of overrides.

    With the seed s, environment i draws from (s, i), for any N.

    Raises:
        ConfigError: a setting is wrong.

    >>> import gymnasium
    >>> envs = gymnasium.make_vec("auvbench/Waypoint-v1", num_envs=3, k=40)
    >>> observations, info = envs.reset(seed=1)
    >>> observations.shape, info["distance"].shape
    ((3, 10), (3,))
    """

    metadata = {  # noqa: RUF012
        "render_modes": list(rendering.MODES),
        "render_fps": 10,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        overrides: settings.Overrides = (),
        config: schema.TrainConfig | None = None,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        conf: str | Path | None = None,
        **keywords: Any,
    ) -> None:
        if num_envs < 1:
            raise ConfigError(f"num_envs={num_envs}: must be at least 1")
        typed = settings.configuration(config, overrides, conf, **keywords)
        settings.refuse_team(typed)
        self.config = settings.limited(typed, max_episode_steps)
        self.autoreset_mode = _mode(autoreset_mode)
        self.batch = Batch(self.config, num_envs, autoreset=self.autoreset_mode == AutoresetMode.SAME_STEP)
        self.num_envs = num_envs
        self.single_observation_space, self.single_action_space = settings.spaces_of(self.batch)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.render_mode = render_mode
        self.metadata = type(self).metadata | {
            "render_fps": rendering.speed(self.config.step.frequency),
            "autoreset_mode": self.autoreset_mode,
        }
        self._renderer = rendering.Renderer(render_mode, self.batch)
        self._seeded = False
        self._ended = np.ones(num_envs, dtype=np.bool_)  # at creation, no environment has an episode

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Arrays, dict[str, Any]]:
        """Begin an episode in all environments, or only where `options["reset_mask"]` is true.

        Args:
            seed: one seed, with which environment i draws from (seed, i); or one seed for each environment, which
                then draws like a single environment with this seed (None: its next episode). Seeds of 2^32 and more
                are hashed to 32 bits.
            options: `reset_mask` (n,) of booleans; `pose`, which replaces the drawn start; `waypoint` or `distance`,
                which replaces the drawn goal. Each of the last three has one value for all environments, or a row for
                each environment that is reset (`auvbench.envs.settings.places`).

        Raises:
            ConfigError: a seed or an option is wrong.
            ResetNeeded: a mask leaves out environments whose first episode has not begun.
        """
        checked = settings.check_options(options, "reset_mask")
        mask = self._mask(checked.get("reset_mask"))
        indices = np.flatnonzero(mask)
        places = settings.places(checked, len(indices), self.config.task, self.batch.position_bounds)
        self._reseed(seed, indices)
        observation = self.batch.reset(indices, **places)
        self._ended[indices] = False
        self._renderer.begin(indices)
        infos = info.batch(self.batch.state, np.zeros(self.num_envs, dtype=np.bool_), mask)
        return observation.copy(), infos

    def _mask(self, value: Any) -> NDArray[np.bool_]:
        """Return which environments (n,) are reset."""
        if value is None:
            return np.ones(self.num_envs, dtype=np.bool_)
        mask = np.asarray(value)
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_ or not mask.any():
            raise ConfigError(
                f"options['reset_mask']: has shape {mask.shape} of {mask.dtype} with {np.count_nonzero(mask)} true; "
                f"must be ({self.num_envs},) of bool with at least one true"
            )
        if not self._seeded and not mask.all():
            raise ResetNeeded("the first reset() begins an episode in all environments: leave out reset_mask")
        return mask.copy()

    def _reseed(self, seed: int | Sequence[int | None] | None, indices: NDArray[np.int64]) -> None:
        if isinstance(seed, Sequence | np.ndarray):
            if len(seed) != self.num_envs:
                raise ConfigError(
                    f"seed: {len(seed)} seeds for {self.num_envs} environments; give one for each"
                )
            seeds = [None if s is None else settings.folded(s) for s in seed]
            super().reset(seed=None)
            if not self._seeded:
                self.batch.reseed(int(self.np_random.integers(1 << 32)))
            own = np.array([i for i in indices.tolist() if seeds[i] is not None], dtype=np.int64)
            self.batch.reseed_each(own, [s for i in own.tolist() if (s := seeds[i]) is not None])
        elif seed is not None or not self._seeded:
            number = None if seed is None else settings.folded(seed)
            super().reset(seed=seed)
            if number is None:
                number = int(self.np_random.integers(1 << 32))
            self.batch.reseed(number, indices)
        self._seeded = True

    def step(self, actions: Arrays) -> tuple[Arrays, Arrays, Arrays, Arrays, dict[str, Any]]:
        """Advance every environment by one agent step with actions (n, n_u), clipped to [-1, 1].

        Raises:
            ResetNeeded: before the first `reset`; and with `DISABLED`, after an episode's end.
            ActionError: the actions have a wrong shape, a NaN or an infinity.
        """
        begin = np.flatnonzero(self._ended)
        if len(begin) and not (self._seeded and self.autoreset_mode == AutoresetMode.NEXT_STEP):
            raise ResetNeeded(
                f"no episode is under way in environment {begin[0]}"
                f"{f' and {len(begin) - 1} others' if len(begin) > 1 else ''}: call reset() before step()"
            )
        result = self.batch.step(np.asarray(actions), begin)
        if self.autoreset_mode != AutoresetMode.SAME_STEP:
            self._ended = result.terminated | result.truncated
        if self.render_mode is not None:
            self._renderer.follow_step(result, begin)
            if self.autoreset_mode == AutoresetMode.SAME_STEP:
                self._renderer.begin(result.ended)
        return (
            result.observation.copy(),
            result.reward.copy(),
            result.terminated.copy(),
            result.truncated.copy(),
            self._info(result),
        )

    def _info(self, result: Transition) -> dict[str, Any]:
        n, state = self.num_envs, self.batch.state
        infos = info.batch(state, np.zeros(n, dtype=np.bool_), np.ones(n, dtype=np.bool_))
        if not result.records:
            return infos
        rows = result.terminated | result.truncated
        if self.autoreset_mode == AutoresetMode.SAME_STEP:
            # Gymnasium's own final_obs is an array of objects, which Gymnasium cannot convert to tensors.
            last = np.zeros_like(result.observation)
            last[result.ended] = result.final_observation
            final = info.final(result.final_state, result.ended, result.records, rows)
            infos |= {"final_obs": last, "_final_obs": rows, "final_info": final, "_final_info": rows.copy()}
        else:
            infos["is_success"][result.ended] = [r["outcome"] == "success" for r in result.records]
            infos |= {"record": info.table(result.ended, result.records, rows), "_record": rows}
        return infos

    def render(self) -> Any:
        """Return the picture or line of each environment as a tuple; None without a `render_mode`.

        Raises:
            ResetNeeded: no episode has begun.
        """
        if not self._seeded:
            raise ResetNeeded("there is nothing to show: call reset() before render()")
        if self.render_mode is None:
            return None
        return tuple(self._renderer.show(i) for i in range(self.num_envs))


def _mode(mode: AutoresetMode | str) -> AutoresetMode:
    """Return the mode with a name such as `NEXT_STEP` or `NextStep`.

    Raises:
        ConfigError: the name is unknown.
    """
    if isinstance(mode, AutoresetMode):
        return mode
    for member in AutoresetMode:
        if mode in (member.name, member.value):
            return member
    raise ConfigError(
        f"autoreset_mode={mode}: unknown; {closest(str(mode), [m.name for m in AutoresetMode])}"
    )


WaypointVectorEnv = AuvVectorEnv
"""Earlier name of `AuvVectorEnv`."""

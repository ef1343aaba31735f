"""PettingZoo's Parallel API to one team: `auvbench.parallel_env("auvbench/Formation-v0")`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

import auvbench
from auvbench.config import schema
from auvbench.envs import info, settings
from auvbench.envs.batch import Batch
from auvbench.errors import ActionError, ConfigError, MissingExtraError, closest
from auvbench.record import Record

try:
    from pettingzoo import ParallelEnv
except ImportError as missing:
    raise MissingExtraError("pettingzoo", extra="teams", purpose="auvbench.parallel_env") from missing

Observation = NDArray[np.float32]
STATE = 19
"""Number of values of each vehicle in `AuvParallelEnv.state`"""


def make(
    id: str,
    overrides: settings.Overrides = (),
    config: schema.TrainConfig | None = None,
    *,
    vehicles: int | None = None,
    conf: str | Path | None = None,
    **keywords: Any,
) -> AuvParallelEnv:
    """Return the team environment of an id; see `auvbench.parallel_env`."""
    if id not in auvbench.TEAMS:
        raise ConfigError(f"{id}: is not the id of a team's environment; {closest(id, auvbench.TEAMS)}")
    lines = settings.split(overrides)
    if vehicles is not None:
        lines.append(f"task.vehicles={vehicles}")
    if config is None:
        keywords.setdefault("task", auvbench.TEAMS[id])
    typed = settings.configuration(config, lines, conf, **keywords)
    if typed.task.name != auvbench.TEAMS[id]:
        raise ConfigError(f"{id}: task={typed.task.name} is another task; must be task={auvbench.TEAMS[id]}")
    return AuvParallelEnv(typed)


class AuvParallelEnv(ParallelEnv):  # type: ignore[misc]
    """One team of vehicles `vehicle_0`, `vehicle_1` and so on, whose episodes begin and end together.

    With the same seed and actions, this environment and the first team of a `Batch` give bit-identical floats.
    `auvbench.envs.info` describes `info`; `record` in it describes the whole team.

    Args:
        config: complete configuration with a task for teams.
    """

    metadata = {"name": "auvbench/Formation-v0", "render_modes": [], "is_parallelizable": True}  # noqa: RUF012

    def __init__(self, config: schema.TrainConfig) -> None:
        self.config = config
        self.batch = Batch(config, 1, autoreset=False)
        self.render_mode = None
        self.possible_agents = [f"vehicle_{j}" for j in range(self.batch.n)]
        self.agents: list[str] = []
        each = {agent: settings.spaces_of(self.batch) for agent in self.possible_agents}
        self.observation_spaces = {agent: observation for agent, (observation, _) in each.items()}
        self.action_spaces = {agent: action for agent, (_, action) in each.items()}
        self.state_space = spaces.Box(-np.inf, np.inf, (STATE * self.batch.n,), dtype=np.float32)
        self._random = np.random.default_rng()
        self._seeded = False

    def observation_space(self, agent: str) -> spaces.Box:
        """Return the space of a vehicle's observations (n_obs,), the same object in each call."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Box:
        """Return the space of a vehicle's actions (n_u,), the same object in each call."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Observation], dict[str, dict[str, Any]]]:
        """Begin an episode: episode 0 of `seed`; without a seed, the next episode. `options` have no effect.

        Raises:
            ConfigError: the seed is wrong.
        """
        if seed is not None or not self._seeded:
            self.batch.reseed(int(self._random.integers(1 << 32)) if seed is None else settings.folded(seed))
            self._seeded = True
        observation = self.batch.reset()
        self.agents = self.possible_agents[:]
        state = self.batch.state
        return self._by_agent(observation.copy()), self._by_agent(
            [info.single(state, j) for j in range(self.batch.n)]
        )

    def step(
        self, actions: dict[str, NDArray[np.float32]]
    ) -> tuple[
        dict[str, Observation],
        dict[str, float],
        dict[str, bool],
        dict[str, bool],
        dict[str, dict[str, Any]],
    ]:
        """Advance by one agent step of 1/frequency seconds with an action (n_u,) of each vehicle, clipped to [-1, 1].

        Raises:
            ResetNeeded: no episode is under way.
            ActionError: a vehicle has no action, or an action has a wrong shape, a NaN or an infinity.
        """
        if not self.agents:
            raise ResetNeeded("no episode is under way: call reset() before step()")
        if actions.keys() != set(self.agents):
            raise ActionError(
                f"actions of {', '.join(actions) or 'no vehicle'}: must have an action of {', '.join(self.agents)}"
            )
        shape = (len(self.batch.vehicle.actuators),)
        values = {agent: np.asarray(actions[agent]) for agent in self.agents}
        for agent, value in values.items():
            if value.shape != shape:
                raise ActionError(f"the action of {agent} has shape {value.shape}: must be {shape}")
        result = self.batch.step(np.stack(list(values.values())))
        if result.records:
            self.agents = []
        records: Sequence[Record | None] = result.records or [None] * self.batch.n
        state = self.batch.state
        return (
            self._by_agent(result.observation.copy()),
            self._by_agent(result.reward.tolist()),
            self._by_agent(result.terminated.tolist()),
            self._by_agent(result.truncated.tolist()),
            self._by_agent([info.single(state, j, record) for j, record in enumerate(records)]),
        )

    def state(self) -> Observation:
        """Return the true state of the team for a central critic. Each vehicle has 19 values: its pose (7), its velocity (6), and the
        position (3) and velocity (3) of its reference.

        Raises:
            ResetNeeded: no episode has begun.
        """
        if not self._seeded:
            raise ResetNeeded("there is no state: call reset() first")
        task, simulator = self.batch.task, self.batch.simulator
        parts = simulator.pose, simulator.velocity, task.reference, task.episodes.reference_velocity
        return np.concatenate(parts, axis=1).ravel().astype(np.float32)

    def close(self) -> None:
        """Do nothing: the environment has nothing to release."""

    def _by_agent(self, rows: Any) -> dict[str, Any]:
        return dict(zip(self.possible_agents, rows, strict=True))

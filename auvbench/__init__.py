"""auvbench: a benchmark of classical control and reinforcement learning for underwater vehicles.

`import auvbench` registers the Gymnasium ids:

>>> import gymnasium, auvbench
>>> env = gymnasium.make("auvbench/Waypoint-v1", overrides=["vehicle=rexrov", "step.frequency=25"])
"""

import os
import sys
from itertools import product
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from auvbench.envs.parallel_env import AuvParallelEnv

__version__ = "0.1.0"


ID = "auvbench/Waypoint-v1"

ORIGINAL: dict[str, object] = {"vehicle": "bluerov2", "task": "waypoint"}
"""Default settings of the Gymnasium ids that end in -v0: the vehicle and the task of the original study"""


TEAMS = {"auvbench/Formation-v0": "formation"}
"""Ids that `parallel_env` accepts, each with its task; a task in this mapping has several vehicles"""


def parallel_env(id: str, *arguments: Any, **keywords: Any) -> "AuvParallelEnv":
    """Return an environment of several vehicles with PettingZoo's Parallel API; needs `pip install 'auvbench[teams]'`.

    Args:
        id: an id in TEAMS.
        arguments: `overrides` and `config`, the positional arguments of `auvbench.envs.gym_env.AuvEnv`.
        keywords: `vehicles`, the number of vehicles, and all keyword arguments of `AuvEnv`.

    Raises:
        ConfigError: the id or a setting is wrong.
        MissingExtraError: PettingZoo is not installed.

    >>> import auvbench
    >>> env = auvbench.parallel_env("auvbench/Formation-v0", vehicles=2)
    >>> observations, infos = env.reset(seed=1)
    >>> env.agents, observations["vehicle_0"].shape
    (['vehicle_0', 'vehicle_1'], (41,))
    """
    from auvbench.envs import parallel_env as environment

    return environment.make(id, *arguments, **keywords)


def register() -> None:
    """Register the Gymnasium ids; Gymnasium imports an environment only when `gymnasium.make` creates it.

    Each task with one vehicle has an id with its name in camel case: `auvbench/Waypoint-v1`, `auvbench/StationKeeping-v1`,
    and `auvbench/PoleInspection-v1` for a package's task `pole_inspection`. An id that ends in -v1 has the command line's
    default vehicle; an id that ends in -v0 has the original study's vehicle. One id, such as `auvbench/Waypoint-K40-25Hz-v0`,
    exists for each combination of K (of the reward) and frequency in that study.
    """
    from gymnasium.envs.registration import register as add
    from gymnasium.envs.registration import registry

    from auvbench.registry import TASKS

    ids: dict[str, dict[str, object]] = {"Waypoint-v1": {}, "Waypoint-v0": ORIGINAL}
    for k, hz in product((1, 40, 100), (10, 25, 55)):
        ids[f"Waypoint-K{k}-{hz}Hz-v0"] = {**ORIGINAL, "k": k, "frequency": hz}
    for task in TASKS.names():
        if task in TEAMS.values():
            continue
        short = "".join(word.capitalize() for word in task.split("_"))
        ids.setdefault(f"{short}-v1", {"task": task})
        ids.setdefault(f"{short}-v0", {**ORIGINAL, "task": task})
    for short, keywords in ids.items():
        name = f"auvbench/{short}"
        if name not in registry:
            add(
                id=name,
                entry_point="auvbench.envs.gym_env:AuvEnv",
                vector_entry_point="auvbench.envs.vector_env:AuvVectorEnv",
                # Gymnasium counts steps only for the waypoint task; other tasks end by their own time limit in seconds.
                max_episode_steps=1000 if short.startswith("Waypoint-") else None,
                kwargs=keywords,
            )


# The command line does not register the ids: it creates environments without Gymnasium's registry, and importing
# Gymnasium takes five times as long as `auvbench --help`.
if os.path.basename(sys.argv[0] if sys.argv else "") not in ("auvbench", "auvbench.exe"):
    register()

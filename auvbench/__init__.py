"""auvbench: a benchmark of classical control and reinforcement learning for underwater vehicles.

`import auvbench` registers the Gymnasium ids:

>>> import gymnasium, auvbench
>>> env = gymnasium.make("auvbench/Waypoint-v0", overrides=["vehicle=rexrov", "step.frequency=25"])
"""

import os
import sys
from itertools import product

__version__ = "0.1.0"


ID = "auvbench/Waypoint-v0"


def register() -> None:
    """Register the Gymnasium ids (by entry-point strings, so that nothing else is imported).

    The ids are `auvbench/Waypoint-v0`, one for each cell of the original study
    (`auvbench/Waypoint-K40-25Hz-v0`), and one for each further task: `auvbench/StationKeeping-v0`,
    `TrajectoryTracking`, `PathFollowing`, `Docking`. Tasks of installed packages get an id too:
    `PoleInspection` for `pole_inspection`.
    """
    from gymnasium.envs.registration import register as add
    from gymnasium.envs.registration import registry

    from auvbench.registry import TASKS

    ids: dict[str, dict[str, object]] = {"Waypoint": {}}
    for k, hz in product((1, 40, 100), (10, 25, 55)):
        ids[f"Waypoint-K{k}-{hz}Hz"] = {"k": k, "frequency": hz}
    for task in TASKS.names():
        ids.setdefault("".join(word.capitalize() for word in task.split("_")), {"task": task})
    for short, keywords in ids.items():
        name = f"auvbench/{short}-v0"
        if name not in registry:
            add(
                id=name,
                entry_point="auvbench.envs.gym_env:AuvEnv",
                vector_entry_point="auvbench.envs.vector_env:AuvVectorEnv",
                # Tasks other than the waypoint task have their own time limit, in seconds.
                max_episode_steps=None if "task" in keywords else 1000,
                kwargs=keywords,
            )


# Importing Gymnasium takes five times as long as `auvbench --help`, and the command line creates its
# environments without the registry.
if os.path.basename(sys.argv[0] if sys.argv else "") not in ("auvbench", "auvbench.exe"):
    register()

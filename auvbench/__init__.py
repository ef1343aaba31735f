"""auvbench: which controller tracks waypoints best on an autonomous underwater vehicle, and how sure are we?

`import auvbench` registers the Gymnasium ids:

>>> import gymnasium, auvbench
>>> env = gymnasium.make("auvbench/Waypoint-v0", overrides=["step.frequency=25"])
"""

import os
import sys

__version__ = "0.1.0"


def register() -> None:
    """Registers the Gymnasium ids (by entry-point strings, so that nothing else is imported)."""
    from gymnasium.envs.registration import register as add
    from gymnasium.envs.registration import registry

    if "auvbench/Waypoint-v0" not in registry:
        add(
            id="auvbench/Waypoint-v0",
            entry_point="auvbench.envs.gym_env:WaypointEnv",
            vector_entry_point="auvbench.envs.vector_env:WaypointVectorEnv",
        )


# Gymnasium takes five times as long to import as `auvbench --help` takes to answer, and the command line makes
# its environments without the registry.
if os.path.basename(sys.argv[0] if sys.argv else "") not in ("auvbench", "auvbench.exe"):
    register()

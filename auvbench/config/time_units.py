"""Steps and seconds: what an agent's frequency makes of a limit in seconds and of a discount with a horizon.

The thesis counts both in steps: an episode has 1000 of them and the discount is 0.99 per step, at any frequency.
So an agent at 55 Hz has 18 s for its episode and looks 1.8 s ahead, one at 10 Hz has 100 s and looks 10 s ahead: its
frequency is confounded with time. `task.time_limit` and `algo.horizon_s` set both in seconds instead.
"""

from __future__ import annotations

import math

from auvbench.config import algorithms, schema


def step_limit(task: schema.Task, frequency: float) -> int:
    """Agent steps after which an episode times out: `task.time_limit` in steps, rounded, else `task.max_steps`.

    Args:
        task: the task's configuration.
        frequency: agent steps per second, Hz.
    """
    if task.time_limit is None:
        return task.max_steps
    return round(task.time_limit * frequency)


def discount(algo: algorithms.Network, frequency: float) -> float:
    """Discount per agent step: exp(-1/(frequency horizon)) where `algo.horizon_s` is set, else `algo.gamma`.

    A reward `horizon_s` seconds ahead then weighs 1/e at every frequency. The thesis's 0.99 per step is a horizon of
    -1/(f ln 0.99): 9.95 s at 10 Hz, 1.81 s at 55 Hz.

    >>> from types import SimpleNamespace
    >>> round(discount(SimpleNamespace(gamma=0.5, horizon_s=9.95), 10.0), 5)
    0.99
    """
    if algo.horizon_s is None:
        return algo.gamma
    return math.exp(-1.0 / (frequency * algo.horizon_s))

"""Keys of a configuration that the test of a table fixes for all agents."""

from __future__ import annotations

OF_THE_TEST = ("task.", "noise.", "disturbance.", "simulator.")
"""beginnings of keys that a table's test fixes for all agents"""
OF_THE_AGENT = "task.position_frame"
"""how an agent writes down its observation: no test changes it"""
OWN = "own"
"""protocol that tests each run in its own task, noise and disturbances"""
FREQUENCY = "step.frequency"
"""the test fixes it unless a protocol leaves each run its own"""


def is_fixed(key: str, frequency_fixed: bool) -> bool:
    """Return whether the test of a table fixes a key, so that it only says what a run was trained with.

    >>> is_fixed("disturbance", True), is_fixed("task.goal_radius", True), is_fixed("algo.gamma", True)
    (True, True, False)
    >>> is_fixed("step.frequency", True), is_fixed("step.frequency", False)
    (True, False)
    """
    if key == FREQUENCY:
        return frequency_fixed
    return f"{key}.".startswith(OF_THE_TEST) and key != OF_THE_AGENT

"""Reject tasks in which no episode can succeed or be measured: start out of bounds, goal outside the depth
limits, too little time. The schemas of `config.tasks` call these functions.
"""

from __future__ import annotations

from typing import Any

from auvbench.config.fields import require
from auvbench.config.schema import step_limit


def length(task: Any, frequency: float) -> tuple[int, str]:
    """Return the number of steps of an episode, and the length of the episode as text."""
    steps = step_limit(task, frequency)
    source = f"task.max_steps={task.max_steps}" if task.time_limit is None else "task.time_limit"
    return steps, f"the {steps / frequency:g} s of an episode ({source} at {frequency:g} Hz)"


def at_most(key: str, task: Any, limit: str) -> None:
    """Raise ConfigError if `task.KEY`, a distance at the start, is larger than `task.LIMIT`."""
    most = getattr(task, limit)
    what, why = f"be at most task.{limit}={most:g}", "a larger distance is out of bounds"
    refuse(getattr(task, key) > most, key, task, what, why)


def refuse(wrong: bool, key: str, task: Any, what: str, why: str = "") -> None:
    """Raise ConfigError, `task.KEY=VALUE: must ...`, if `wrong` is true.

    Args:
        what: the text that follows "must", for example "be at most 3".
        why: reason for this limit; '' leaves the reason out.
    """
    require(not wrong, f"task.{key}", getattr(task, key), f"{what}{f': {why}' if why else ''}")

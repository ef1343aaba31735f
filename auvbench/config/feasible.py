"""Reject tasks in which no episode can succeed or be measured: start out of bounds, goal outside the depth
limits, too little time. The schemas of `config.tasks` call these checks.
"""

from __future__ import annotations

import math
from typing import Any

from auvbench.config.schema import step_limit
from auvbench.errors import ConfigError

SHALLOWEST = 1.0
"""distance in m between a path and the depth limits"""
RANDOM_HEIGHT = 0.3
"""height of a random curve as a share of its size"""
HELIX_CLIMB = 0.2 / math.hypot(1.0, 0.2)
"""vertical speed of a helix as a share of its speed"""


def check_waypoints(task: Any) -> None:
    """Reject a box of waypoints that is empty or outside the depth limits."""
    for axis, least, most in zip("xyz", task.waypoint_low, task.waypoint_high, strict=True):
        _refuse(least > most, "waypoint_low", task, f"be at most task.waypoint_high in {axis}")
    bottom, top = task.waypoint_low[2], task.waypoint_high[2]
    what = "no waypoint would be between the depth limits"
    _refuse(bottom > task.depth_high, "waypoint_low", task, f"have a z of at most {task.depth_high:g}", what)
    _refuse(top < task.depth_low, "waypoint_high", task, f"have a z of at least {task.depth_low:g}", what)


def check_start_radius(task: Any) -> None:
    """Reject starts out of bounds."""
    _at_most("start_radius", task, "bounds")


def check_dock(task: Any) -> None:
    """Reject starts out of bounds, or so near that they collide with the dock."""
    _at_most("start_high", task, "bounds")
    what = f"be at least task.clearance={task.clearance:g}"
    why = "a smaller distance from the dock is a collision"
    _refuse(task.start_low < task.clearance, "start_low", task, what, why)


def check_hold(task: Any, frequency: float) -> None:
    """Reject a settling time or a hold time longer than an episode."""
    steps, length = _length(task, frequency)
    what = "the RMS errors exclude that time and need at least one step"
    _refuse(round(task.settling * frequency) >= steps, "settling", task, f"be less than {length}", what)
    hold_steps = round(task.hold_time * frequency)
    _refuse(hold_steps > steps, "hold_time", task, f"be at most {length}")
    _refuse(hold_steps < 1, "hold_time", task, f"be at least a step, {1 / frequency:g} s")


def _length(task: Any, frequency: float) -> tuple[int, str]:
    """Return the steps of an episode, and its length in words."""
    steps = step_limit(task, frequency)
    source = f"task.max_steps={task.max_steps}" if task.time_limit is None else "task.time_limit"
    return steps, f"the {steps / frequency:g} s of an episode ({source} at {frequency:g} Hz)"


def check_path(task: Any) -> None:
    room = SHALLOWEST + task.overshoot
    low, high = task.depth_low + room, task.depth_high - room
    key, why = "task.depth_low", f"a path may leave the depths of its points by {task.overshoot:.3g} m"
    if low > high:
        raise ConfigError(
            f"{key}={task.depth_low:g}: must be at most {task.depth_high - 2 * room:g}, {2 * room:.3g} m below "
            f"task.depth_high={task.depth_high:g}: {why}"
        )
    inside = low <= task.start[2] <= high
    _refuse(not inside, "start", task, f"have a z of at least {low:.4g} and at most {high:.4g}", why)


def check_curve(task: Any, frequency: float) -> None:
    """Reject depth limits between which a curve does not fit."""
    steps, length = _length(task, frequency)
    seconds = steps / frequency
    height = RANDOM_HEIGHT * task.size_high if task.curve in ("random", "any") else 0.0
    rise = HELIX_CLIMB * task.speed_high * seconds if task.curve in ("helix", "any") else 0.0
    low, high = task.depth_low + height, task.depth_high - max(height, rise)
    if low > high:
        raise ConfigError(
            f"task.curve={task.curve}: rises by up to {max(height, rise):.3g} m in {length}; must fit between "
            f"task.depth_low={task.depth_low:g} and task.depth_high={task.depth_high:g}"
        )
    what = f"have a z of at least {low:.4g} and at most {high:.4g}"
    why = f"task.curve={task.curve} rises by up to {max(height, rise):.3g} m in {length}"
    _refuse(not low <= task.centre[2] <= high, "centre", task, what, why)


def _at_most(key: str, task: Any, limit: str) -> None:
    most = getattr(task, limit)
    _refuse(
        getattr(task, key) > most,
        key,
        task,
        f"be at most task.{limit}={most:g}",
        "a larger distance is out of bounds",
    )


def _refuse(wrong: bool, key: str, task: Any, what: str, why: str = "") -> None:
    if wrong:
        value = getattr(task, key)
        shown = f"{value:.12g}" if isinstance(value, float) else value
        raise ConfigError(f"task.{key}={shown}: must {what}{f': {why}' if why else ''}")

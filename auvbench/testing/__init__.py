"""Conformance suites: checks that every agent, task, reward, block, disturbance, simulator, launcher, tracker and command must pass,
auvbench's own included.

>>> from auvbench.testing import check_agent, check_block, check_disturbance, check_simulator, check_task
>>> check_agent("algo=pid")
>>> check_task("task=docking", "vehicle=bluerov2_heavy")
>>> check_disturbance("disturbance=severe")
>>> check_simulator("simulator=fossen")
>>> check_block("task.observation=[position_error,velocity]")

Each function raises a `ConformanceError` (an `AssertionError`) with what is wrong. `pytest --auvbench algo=NAME --auvbench
task=NAME --auvbench reward=NAME` and so on runs the same checks without any code, with one test for each check (`SUITES`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from auvbench.testing.agents import AGENT_CHECKS, LEARNER_CHECKS, check_agent
from auvbench.testing.blocks import BLOCK_CHECKS, check_block
from auvbench.testing.commands import COMMAND_CHECKS, check_command
from auvbench.testing.disturbances import DISTURBANCE_CHECKS, check_disturbance
from auvbench.testing.draws import ConformanceError
from auvbench.testing.launchers import LAUNCHER_CHECKS, check_launcher
from auvbench.testing.rewards import REWARD_CHECKS, check_reward
from auvbench.testing.simulators import SIMULATOR_CHECKS, check_simulator
from auvbench.testing.tasks import TASK_CHECKS, check_task
from auvbench.testing.trackers import TRACKER_CHECKS, check_tracker

SUITES: dict[str, tuple[tuple[Callable[[Any], None], ...], Callable[..., None]]] = {
    "task=": (TASK_CHECKS, check_task),
    "reward=": (REWARD_CHECKS, check_reward),
    "task.observation=": (BLOCK_CHECKS, check_block),
    "disturbance=": (DISTURBANCE_CHECKS, check_disturbance),
    "simulator=": (SIMULATOR_CHECKS, check_simulator),
    "launcher=": (LAUNCHER_CHECKS, check_launcher),
}
"""For each kind of part, its checks and the function that runs them, by the override that chooses the part. `algo=` is not a key,
because it has two suites of checks; `check_agent` runs both."""

NAMED: dict[str, tuple[tuple[Callable[[Any], None], ...], Callable[..., None]]] = {
    "train.log=": (TRACKER_CHECKS, check_tracker),
    "command=": (COMMAND_CHECKS, check_command),
}
"""Like `SUITES`, but for the kinds of parts whose checks need only the part's name and no configuration."""

__all__ = [
    "AGENT_CHECKS",
    "BLOCK_CHECKS",
    "COMMAND_CHECKS",
    "DISTURBANCE_CHECKS",
    "LAUNCHER_CHECKS",
    "LEARNER_CHECKS",
    "NAMED",
    "REWARD_CHECKS",
    "SIMULATOR_CHECKS",
    "SUITES",
    "TASK_CHECKS",
    "TRACKER_CHECKS",
    "ConformanceError",
    "check_agent",
    "check_block",
    "check_command",
    "check_disturbance",
    "check_launcher",
    "check_reward",
    "check_simulator",
    "check_task",
    "check_tracker",
]

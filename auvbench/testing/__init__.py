"""Conformance suites: checks that every agent and task must pass, auvbench's own included.

>>> from auvbench.testing import check_agent, check_task
>>> check_agent("algo=pid")
>>> check_task("task=docking", "vehicle=bluerov2_heavy")

Each function raises a `ConformanceError` (an `AssertionError`) with what is wrong. `pytest --auvbench
algo=NAME --auvbench task=NAME` runs the same checks without any code, one test each.
"""

from __future__ import annotations

from auvbench.testing.agents import AGENT_CHECKS, LEARNER_CHECKS, check_agent
from auvbench.testing.draws import ConformanceError
from auvbench.testing.tasks import TASK_CHECKS, check_task

__all__ = [
    "AGENT_CHECKS",
    "LEARNER_CHECKS",
    "TASK_CHECKS",
    "ConformanceError",
    "check_agent",
    "check_task",
]

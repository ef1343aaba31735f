"""Conformance suites: what auvbench asks of every agent and task, its own included.

>>> from auvbench.testing import check_agent, check_task
>>> check_agent("algo=pid")
>>> check_task("task=docking", "vehicle=bluerov2_heavy")

Each function raises a `ConformanceError`, an `AssertionError`, that says what is wrong. Without a line of code:
`pytest --auvbench algo=NAME --auvbench task=NAME` runs the same checks, one test each.
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

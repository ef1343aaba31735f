"""Conformance suites: checks that every agent, task and simulator must pass, auvbench's own included.

>>> from auvbench.testing import check_agent, check_simulator, check_task
>>> check_agent("algo=pid")
>>> check_task("task=docking", "vehicle=bluerov2_heavy")
>>> check_simulator("simulator=fossen")

Each function raises a `ConformanceError` (an `AssertionError`) with what is wrong. `pytest --auvbench
algo=NAME --auvbench task=NAME --auvbench simulator=NAME` runs the same checks without any code, one test each.
"""

from __future__ import annotations

from auvbench.testing.agents import AGENT_CHECKS, LEARNER_CHECKS, check_agent
from auvbench.testing.draws import ConformanceError
from auvbench.testing.simulators import SIMULATOR_CHECKS, check_simulator
from auvbench.testing.tasks import TASK_CHECKS, check_task

__all__ = [
    "AGENT_CHECKS",
    "LEARNER_CHECKS",
    "SIMULATOR_CHECKS",
    "TASK_CHECKS",
    "ConformanceError",
    "check_agent",
    "check_simulator",
    "check_task",
]

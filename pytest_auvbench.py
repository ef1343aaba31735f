"""pytest's plug-in of auvbench: `pytest --auvbench algo=NAME --auvbench task=NAME --auvbench simulator=NAME` runs the conformance suites.

A module outside the package, because pytest imports it in every session of an environment that has auvbench, and
until `--auvbench` is given it imports nothing but pytest.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("auvbench")
    group.addoption(
        "--auvbench",
        action="append",
        default=[],
        metavar="OVERRIDES",
        help="check an agent ('algo=NAME ...'), a task ('task=NAME ...') or a simulator ('simulator=NAME ...') against auvbench's contracts; may be given "
        "several times",
    )
    group.addoption(
        "--auvbench-steps",
        type=int,
        default=2000,
        metavar="N",
        help="environment steps of the trainings with which an agent that learns is checked (default 2000)",
    )


def pytest_collection_modifyitems(
    session: pytest.Session, config: pytest.Config, items: list[pytest.Item]
) -> None:
    for typed in config.getoption("--auvbench"):
        items.extend(_checks(session, str(typed), int(config.getoption("--auvbench-steps"))))


def _checks(session: pytest.Session, typed: str, steps: int) -> list[Check]:
    from auvbench import testing
    from auvbench.config.algorithms import learns
    from auvbench.config.compose import compose
    from auvbench.errors import AuvbenchError

    overrides = typed.split()
    try:
        algo = compose("train", overrides).algo
    except AuvbenchError as error:
        raise pytest.UsageError(f"--auvbench '{typed}': {error}") from None
    chosen: list[tuple[Any, Callable[[], None]]] = []
    checks: tuple[Any, ...]
    if any(word.startswith("task=") for word in overrides):
        for one_of_a_task in testing.TASK_CHECKS:
            chosen.append((one_of_a_task, partial(testing.check_task, *overrides, only=one_of_a_task)))
    if any(word.startswith("simulator=") for word in overrides):
        for one_of_a_simulator in testing.SIMULATOR_CHECKS:
            chosen.append(
                (one_of_a_simulator, partial(testing.check_simulator, *overrides, only=one_of_a_simulator))
            )
    if any(word.startswith("algo=") for word in overrides) or not chosen:
        checks = (*testing.AGENT_CHECKS, *(testing.LEARNER_CHECKS if learns(algo) else ()))
        for one in checks:
            chosen.append((one, partial(testing.check_agent, *overrides, steps=steps, only=one)))
    return [
        Check.from_parent(session, name=f"auvbench[{typed}]::{check.__name__}", call=call)
        for check, call in chosen
    ]


class Check(pytest.Item):
    """One check of one agent, task or simulator."""

    def __init__(self, *, call: Callable[[], None], **named: Any) -> None:
        super().__init__(**named)
        self._call = call

    def runtest(self) -> None:
        self._call()

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        from auvbench.testing import ConformanceError

        if isinstance(excinfo.value, ConformanceError):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Any, int | None, str]:
        return self.path, None, self.name

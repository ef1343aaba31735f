"""pytest's plug-in of auvbench: `pytest --auvbench algo=NAME --auvbench task=NAME` and so on runs the conformance suites.

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
        help="check an agent ('algo=NAME ...'), task, reward, disturbance, launcher or simulator, blocks ('task.observation=[NAME]'), a tracker ('train.log=NAME') or "
        "a command ('command=NAME') against auvbench's contracts; may be given several times",
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
    chosen: list[tuple[Any, Callable[[], None]]] = []
    for prefix, (of_a_name, check) in testing.NAMED.items():
        if len(overrides) == 1 and overrides[0].startswith(prefix):
            name = overrides[0].removeprefix(prefix)
            chosen = [(one, partial(check, name, only=one)) for one in of_a_name]
            return _items(session, typed, chosen)
    try:
        algo = compose("train", overrides).algo
    except AuvbenchError as error:
        raise pytest.UsageError(f"--auvbench '{typed}': {error}") from None
    checks: tuple[Any, ...]
    for prefix, (checks, check) in testing.SUITES.items():
        if any(word.startswith(prefix) for word in overrides):
            chosen += [(one, partial(check, *overrides, only=one)) for one in checks]
    if any(word.startswith("algo=") for word in overrides) or not chosen:
        checks = (*testing.AGENT_CHECKS, *(testing.LEARNER_CHECKS if learns(algo) else ()))
        for one in checks:
            chosen.append((one, partial(testing.check_agent, *overrides, steps=steps, only=one)))
    return _items(session, typed, chosen)


def _items(session: pytest.Session, typed: str, chosen: list[tuple[Any, Callable[[], None]]]) -> list[Check]:
    return [
        Check.from_parent(session, name=f"auvbench[{typed}]::{check.__name__}", call=call)
        for check, call in chosen
    ]


class Check(pytest.Item):
    """One check of one thing."""

    def __init__(self, *, call: Callable[[], None], **named: Any) -> None:
        super().__init__(**named)
        self._call = call

    def runtest(self) -> None:
        self._call()

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        from auvbench.errors import AuvbenchError
        from auvbench.testing import ConformanceError

        if isinstance(excinfo.value, ConformanceError | AuvbenchError):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Any, int | None, str]:
        return self.path, None, self.name

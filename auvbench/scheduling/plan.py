"""What a sweep is about to do, said in one table before it does it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from rich.console import Console
from rich.table import Table

from auvbench.errors import RunError
from auvbench.runs import status
from auvbench.runs.directory import RunDirectory
from auvbench.runs.status import RunStatus, State


class Action(StrEnum):
    """What happens to a run, in the order of the table."""

    SKIP = "skip"
    RESUME = "resume"
    START = "start"
    RETRY = "retry"
    LEAVE = "leave alone"
    REFUSE = "refuse"


WHY = {
    Action.SKIP: "complete",
    Action.RESUME: "partial",
    Action.START: "missing",
    Action.RETRY: "failed",
    Action.LEAVE: "held by others",
    Action.REFUSE: "damaged",
}

_ACTIONS = {
    State.COMPLETE: Action.SKIP,
    State.INTERRUPTED: Action.RESUME,
    State.PENDING: Action.START,
    State.FAILED: Action.RETRY,
    State.RUNNING: Action.LEAVE,
}

LISTED = 12
"""How many runs of a kind are named one by one."""


@dataclass(frozen=True, slots=True)
class Step:
    """One run and what happens to it."""

    run: RunDirectory
    action: Action
    status: RunStatus | None = None  # None: it cannot be read
    problem: str = ""  # why it is refused

    @property
    def detail(self) -> str:
        """How far it is, what went wrong, or who holds it."""
        if self.status is None:
            return self.problem
        manifest = self.status.manifest
        if self.action is Action.LEAVE:
            return f"by {self.status.holder}"
        if self.action is Action.RETRY:
            error = manifest.get("error") or {}
            return f"{error.get('message', 'no reason given')} (step {manifest['steps']})"
        if self.status.lost:
            return f"{self.status.lost}: from its last checkpoint"
        if self.action is Action.RESUME:
            return f"from step {manifest['steps']} of {manifest['total_steps']}"
        return ""


@dataclass(frozen=True, slots=True)
class Plan:
    """All runs of a sweep."""

    steps: tuple[Step, ...]

    def of(self, action: Action) -> list[Step]:
        return [step for step in self.steps if step.action is action]

    @property
    def todo(self) -> list[RunDirectory]:
        """What is to be carried out, in the order given."""
        return [step.run for step in self.steps if step.action not in _UNTOUCHED]


_UNTOUCHED = (Action.SKIP, Action.LEAVE, Action.REFUSE)


def make(
    runs: Sequence[RunDirectory],
    watched: Callable[[Path], bool] = lambda _: False,
    check: Callable[[RunDirectory], object] | None = None,
) -> Plan:
    """Looks at every run once; a damaged one is refused and costs no other.

    Args:
        runs: the runs of the sweep.
        watched: whether a held run is one of the backend's own jobs, to be waited for and not left alone.
        check: looks further than at the manifest, and raises a RunError where a run is damaged.
    """
    steps = []
    for run in runs:
        try:
            if check is not None:
                check(run)
            found = status.of(run, deep=True)
        except RunError as error:
            steps.append(Step(run, Action.REFUSE, problem=str(error)))
            continue
        action = _ACTIONS[found.state]
        if action is Action.LEAVE and watched(run.path):
            action = Action.RESUME
        steps.append(Step(run, action, found))
    return Plan(tuple(steps))


def show(plan: Plan, console: Console) -> None:
    """The table: a line per kind of run, and each partial, failed or held one by name."""
    count = len(plan.steps)
    table = Table(
        title=f"{count} run{'s' if count != 1 else ''}", title_justify="left", box=None, pad_edge=False
    )
    table.add_column("state")
    table.add_column("runs", justify="right")
    table.add_column("now")
    for action in Action:
        steps = plan.of(action)
        if steps:
            table.add_row(WHY[action], str(len(steps)), _VERBS[action])
    console.print(table)
    for step in plan.of(Action.REFUSE):  # all of them, for each needs a user's hand
        console.print(f"  {WHY[step.action]}: {step.detail}", soft_wrap=True, highlight=False, markup=False)
    for action in (Action.RESUME, Action.RETRY, Action.LEAVE):
        steps = plan.of(action)
        for step in steps[:LISTED]:
            console.print(
                f"  {WHY[action]}: {step.run.id} {step.detail}",
                soft_wrap=True,
                highlight=False,
                markup=False,
            )
        if len(steps) > LISTED:
            console.print(f"  {WHY[action]}: and {len(steps) - LISTED} more")


_VERBS = {
    Action.SKIP: "skipped",
    Action.RESUME: "resumed",
    Action.START: "started",
    Action.RETRY: "retried",
    Action.LEAVE: "left alone",
    Action.REFUSE: "left as it is",
}

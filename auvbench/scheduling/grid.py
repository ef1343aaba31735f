"""From composed configurations to carried-out runs: all checked, then all frozen, then the first started."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from omegaconf import DictConfig, OmegaConf
from rich.console import Console
from rich.table import Table

from auvbench.config import launchers
from auvbench.config.agents import learns
from auvbench.config.validate import train_config
from auvbench.errors import ConfigError, RunError
from auvbench.runs import plan, status
from auvbench.runs.directory import RunDirectory
from auvbench.runs.status import RunStatus, State
from auvbench.scheduling import views
from auvbench.scheduling.base import Backend
from auvbench.scheduling.loop import Loop, Outcome, Result
from auvbench.training import execute
from auvbench.training.worker import TARGET


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


def plan_of(
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


def sweep(
    runs: Sequence[RunDirectory],
    backend: Backend,
    console: Console | None = None,
    *,
    check: Callable[[RunDirectory], object] | None = None,
) -> Result:
    """Brings every run to its end as far as it can be brought.

    Args:
        runs: frozen run directories, each once.
        backend: where they are carried out.
        console: where the tables go; standard output by default.
        check: as in `plan_of`; runs that were frozen just now need none.

    Raises:
        SubmitError: the backend refuses even the only run it has.
        UserError: the backend cannot work here.
    """
    console = console or Console()
    steps = plan_of(runs, watched=lambda path: backend.adopt(path) is not None, check=check)
    show(steps, console)
    todo = steps.todo
    result = Result()
    if todo:
        view = views.View(console, todo, backend.limit)
        result = Loop(todo, backend, view).drive()
    else:
        backend.close()
    for step in steps.of(Action.SKIP):
        result.outcomes[step.run.path] = (Outcome.COMPLETE, "")
    for step in steps.of(Action.LEAVE):
        result.outcomes[step.run.path] = (Outcome.HELD, step.detail)
    for step in steps.of(Action.REFUSE):
        result.outcomes[step.run.path] = (Outcome.FAILED, step.detail)
    for path in result.of(Outcome.HELD):
        if RunDirectory(path).manifest()["state"] == "complete":  # its holder has finished meanwhile
            result.outcomes[path] = (Outcome.COMPLETE, "")
    if todo:
        summarise(result, console)
    return result


def summarise(result: Result, console: Console) -> None:
    """Counts, then each run that needs attention, by name."""
    counts = {outcome: result.of(outcome) for outcome in Outcome}
    text = ", ".join(f"{len(runs)} {outcome}" for outcome, runs in counts.items() if runs)
    total = len(result.outcomes)
    console.print(f"{total} run{'s' if total != 1 else ''}: {text}", highlight=False)
    for outcome in (Outcome.FAILED, Outcome.INTERRUPTED, Outcome.HELD):
        for path, message in counts[outcome].items():
            console.print(f"  {outcome}: {path}: {message}", soft_wrap=True, highlight=False, markup=False)
    if counts[Outcome.INTERRUPTED] or counts[Outcome.NOT_STARTED]:
        console.print("the same command goes on from here", highlight=False)


def carry_out(
    configs: Sequence[DictConfig], command: str = "", *, target: str = TARGET, console: Console | None = None
) -> Result:
    """Brings the runs of a grid to their end; `Result.exit_code` is the command's.

    Args:
        configs: a configuration per job, composed; jobs that resolve to the same run are one.
        command: the command line, for the manifests.
        target: what a worker calls with a run directory, as module:function.
        console: where the tables go; standard output by default.

    Raises:
        ConfigError, VehicleError, MissingExtraError: a job cannot run; nothing has been written then.
        RunError: a run's directory holds another configuration, or cannot be written.
    """
    distinct: dict[Path, DictConfig] = {}
    for config in configs:
        distinct.setdefault(plan.resolve_run(config).path, config)
    for config in distinct.values():
        execute.check_runnable(train_config(config))
    learning = any(learns(config.algo) for config in distinct.values())
    chosen = backend(configs[0].launcher, target=target, learning=learning)
    if any(config.launcher != configs[0].launcher for config in configs):
        raise ConfigError("launcher: a grid has one launcher; it cannot be an axis")
    runs: list[RunDirectory] = [plan.prepare(config, command) for config in distinct.values()]
    return sweep(runs, chosen, console)


def backend(launcher: DictConfig, *, target: str = TARGET, learning: bool = True) -> Backend:
    """Return the backend that a `launcher` configuration names.

    Args:
        launcher: the composed `launcher` group.
        target: what a worker calls with a run directory, as module:function.
        learning: whether any of the runs learns; otherwise torch is not imported.

    Raises:
        UserError: it cannot work on this machine.
    """
    options = OmegaConf.to_object(launcher)
    # Imported when chosen: each backend has needs of its own.
    if isinstance(options, launchers.Slurm):
        from auvbench.scheduling.slurm import SlurmBackend

        return SlurmBackend(options, target=target)
    if isinstance(options, launchers.Ray):
        from auvbench.scheduling.ray import RayBackend

        return RayBackend(options, target=target)
    if isinstance(options, launchers.Local):
        from auvbench.scheduling.local import CONTROLLERS, LEARNERS, LocalBackend

        return LocalBackend(options.workers, target=target, preload=LEARNERS if learning else CONTROLLERS)
    raise ConfigError("launcher: its file must start from a schema (see conf/launcher)")

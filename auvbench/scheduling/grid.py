"""Turn composed configurations into finished runs: check all runs, create all run directories, then carry out the runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from auvbench.config.algorithms import learns
from auvbench.config.launchers import Launcher, LauncherConfig
from auvbench.errors import AgentError, ConfigError, RunError
from auvbench.registry import LAUNCHERS, owner, resolve, telling
from auvbench.runs import status
from auvbench.runs.directory import RunDirectory
from auvbench.runs.status import State
from auvbench.scheduling import views
from auvbench.scheduling.loop import Backend, Loop, Outcome, Result
from auvbench.training.worker import TARGET

if TYPE_CHECKING:
    from omegaconf import DictConfig

    from auvbench.runs.plan import Plan


class Action(Enum):
    """What a sweep does with a run, in the order of the summary. Each value has two words: the run's state and the action."""

    SKIP = "complete", "skipped"
    RESUME = "partial", "resumed"
    START = "missing", "started"
    RETRY = "failed", "retried"
    LEAVE = "locked", "left alone"
    REFUSE = "damaged", "skipped"


_ACTIONS = {
    State.COMPLETE: Action.SKIP,
    State.INTERRUPTED: Action.RESUME,
    State.PENDING: Action.START,
    State.FAILED: Action.RETRY,
    State.RUNNING: Action.LEAVE,
}

TODO = (Action.RESUME, Action.START, Action.RETRY)
"""Actions that train a run."""

LISTED = 12
"""Largest number of runs that are listed by name for each action. Damaged runs are all listed, since the user must look at
each damaged run.
"""


@dataclass(frozen=True, slots=True)
class Step:
    """One run and its action."""

    run: RunDirectory
    action: Action
    detail: str = ""
    """progress, error, or holder of the run"""


def step_of(
    run: RunDirectory, backend: Backend, check: Callable[[RunDirectory], object] = lambda run: None
) -> Step:
    """Return a sweep's action for an existing run, with the detail that the summary shows."""
    try:
        check(run)
        present = status.of(run, deep=True)
    except RunError as error:
        return Step(run, Action.REFUSE, str(error))
    action, manifest = _ACTIONS[present.state], present.manifest
    if action is Action.LEAVE:
        if backend.adopt(run.path) is None:
            return Step(run, action, f"by {present.holder}")
        action = Action.RESUME  # The run is locked by a job of this backend; the sweep waits for this job.
    detail = ""
    if action is Action.RETRY:
        why = (manifest.get("error") or {}).get("message", "no reason given")
        detail = f"{why} (step {manifest['steps']})"
    elif present.lost:
        detail = f"{present.lost}: from its last checkpoint"
    elif action is Action.RESUME:
        detail = f"from step {manifest['steps']} of {manifest['total_steps']}"
    return Step(run, action, detail)


def say(console: Console, text: str) -> None:
    """Print a line without line breaks or markup, also on a narrow terminal."""
    console.print(text, soft_wrap=True, highlight=False, markup=False)


def show(steps: Sequence[Step], say: Callable[[str], None]) -> None:
    """Print the number of runs with each action, and list the partial, failed, locked and damaged runs."""
    say(f"{len(steps)} run{'s' if len(steps) != 1 else ''}")
    for action in Action:
        named = [step for step in steps if step.action is action]
        what, done = action.value
        if named:
            say(f"  {what:<14} {len(named):>5}  {done}")
        limit = None if action is Action.REFUSE else LISTED
        for step in named[:limit]:
            if step.detail:
                say(f"  {what}: {step.detail if limit is None else f'{step.run.id} {step.detail}'}")
        if len(named) > LISTED and limit and named[0].detail:
            say(f"  {what}: and {len(named) - LISTED} more")


def sweep(
    runs: Sequence[RunDirectory],
    backend: Backend,
    console: Console | None = None,
    *,
    check: Callable[[RunDirectory], object] = lambda run: None,
) -> Result:
    """Carry out every run as far as possible; a damaged run does not stop the others.

    Args:
        runs: frozen run directories without duplicates.
        backend: backend that carries out the runs.
        console: console for the tables; standard output by default.
        check: function that is called with each run before its status is read, and raises RunError for a damaged run.

    Raises:
        SubmitError: the backend refuses a run although no other run is active.
        UserError: the backend cannot work here.
    """
    console = console or Console()
    steps = [step_of(run, backend, check) for run in runs]
    show(steps, partial(say, console))
    todo = [step.run for step in steps if step.action in TODO]
    result = Result()
    if todo:
        result = Loop(todo, backend, views.View(console, todo)).drive()
    else:
        backend.close()
    ends = {Action.SKIP: Outcome.COMPLETE, Action.LEAVE: Outcome.HELD, Action.REFUSE: Outcome.FAILED}
    for step in steps:
        if step.action in ends:
            result.outcomes[step.run.path] = (ends[step.action], step.detail)
    for path in result.of(Outcome.HELD):
        if (
            RunDirectory(path).manifest()["state"] == "complete"
        ):  # The run's holder has finished it meanwhile.
            result.outcomes[path] = (Outcome.COMPLETE, "")
    if todo:
        summarise(result, console)
    return result


def summarise(result: Result, console: Console) -> None:
    """Print the number of runs with each outcome, then each failed, interrupted or locked run."""
    counts = {outcome: result.of(outcome) for outcome in Outcome}
    text = ", ".join(f"{len(runs)} {outcome}" for outcome, runs in counts.items() if runs)
    total = len(result.outcomes)
    console.print(f"{total} run{'s' if total != 1 else ''}: {text}", highlight=False)
    for outcome in (Outcome.FAILED, Outcome.INTERRUPTED, Outcome.HELD):
        for path, message in counts[outcome].items():
            say(console, f"  {outcome}: {path}: {message}")
    if counts[Outcome.INTERRUPTED] or counts[Outcome.NOT_STARTED]:
        console.print("run the same command to continue", highlight=False)


def carry_out(
    configs: Sequence[DictConfig], command: str = "", *, target: str = TARGET, console: Console | None = None
) -> Result:
    """Carry out the runs of a grid; `Result.exit_code` is the command's exit code.

    Args:
        configs: composed configuration of each job; jobs with the same resolved configuration are one run.
        command: command line, for the manifests.
        target: function that a worker calls with a run directory, as module:function.
        console: console for the tables; standard output by default.

    Raises:
        ConfigError, VehicleError, MissingExtraError: a job cannot run; nothing was written.
        RunError: a run's directory has a different configuration, or cannot be written.
    """
    # Imported late: `auvbench resume` of complete runs does not need it.
    from auvbench.runs.plan import freeze_all

    plans = list(planned(configs).values())
    learning = any(learns(plan.config.algo) for plan in plans)
    chosen = backend(configs[0].launcher, target=target, learning=learning)
    return sweep(freeze_all(plans, command), chosen, console)


def planned(configs: Sequence[DictConfig]) -> dict[Path, Plan]:
    """Return the distinct runs of a grid by path, checked as far as possible before they are written.

    Raises:
        ConfigError, VehicleError, MissingExtraError: a job cannot run.
    """
    from auvbench.runs.plan import plan
    from auvbench.training.execute import check_runnable

    if any(config.launcher != configs[0].launcher for config in configs):
        raise ConfigError("launcher: cannot be an axis; a grid has one launcher")
    plans: dict[Path, Plan] = {}
    for config in configs:
        new = plan(config)
        plans.setdefault(new.run.path, new)
    for checked in plans.values():
        check_runnable(checked.config)
    return plans


def backend(launcher: DictConfig, *, target: str = TARGET, learning: bool = True) -> Backend:
    """Return the backend for a `launcher` configuration.

    Args:
        launcher: composed `launcher` group.
        target: function that a worker calls with a run directory, as module:function.
        learning: whether any run learns; otherwise torch is not imported.

    Raises:
        UserError: the backend cannot work on this machine.
        ConfigError: the options have no schema, or the package of the launcher is not installed.
        AgentError: the code of the launcher's package cannot make a backend.
    """
    from omegaconf import OmegaConf

    options = OmegaConf.to_object(launcher)
    if not isinstance(options, Launcher):
        raise ConfigError("launcher: its file must start from a schema (see conf/launcher)")
    code = LAUNCHERS.choose(options.name).code
    if not isinstance(options, LauncherConfig):
        own: Backend = resolve(code)(options, target, learning)  # imports what this launcher needs
        return own
    owner_name = owner("launcher", options)
    with telling(owner_name, "cannot be made"):
        instance: Backend = resolve(code)(options, target, learning)
        needed = ("limit", "submit", "adopt", "wait", "close")
        if lacking := [name for name in needed if not hasattr(instance, name)]:
            raise AgentError(
                f"{owner_name}: its result, a {type(instance).__name__}, lacks {', '.join(lacking)} "
                "(auvbench.scheduling.loop.Backend)"
            )
    return instance

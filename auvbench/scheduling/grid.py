"""From composed configurations to carried-out runs: all checked, then all frozen, then the first started."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from auvbench.config.algorithms import learns
from auvbench.config.launchers import Launcher, LauncherConfig
from auvbench.errors import AgentError, ConfigError, RunError
from auvbench.registry import LAUNCHERS, resolve, telling
from auvbench.runs import status
from auvbench.runs.directory import RunDirectory
from auvbench.runs.status import State
from auvbench.scheduling import views
from auvbench.scheduling.loop import Backend, Loop, Outcome, Result
from auvbench.training.worker import TARGET

if TYPE_CHECKING:
    from omegaconf import DictConfig


class Action(Enum):
    """What happens to a run, in the order of the summary; the values say what it is and what is done."""

    SKIP = "complete", "skipped"
    RESUME = "partial", "resumed"
    START = "missing", "started"
    RETRY = "failed", "retried"
    LEAVE = "held by others", "left alone"
    REFUSE = "damaged", "left as it is"


_ACTIONS = {
    State.COMPLETE: Action.SKIP,
    State.INTERRUPTED: Action.RESUME,
    State.PENDING: Action.START,
    State.FAILED: Action.RETRY,
    State.RUNNING: Action.LEAVE,
}

LISTED = 12
"""How many runs of a kind are named one by one; damaged ones all are, for each needs a user's hand."""


@dataclass(frozen=True, slots=True)
class Step:
    """One run and what happens to it."""

    run: RunDirectory
    action: Action
    detail: str = ""
    """how far it is, what went wrong, or who holds it"""


def _step(run: RunDirectory, backend: Backend, check: Callable[[RunDirectory], object]) -> Step:
    try:
        check(run)
        found = status.of(run, deep=True)
    except RunError as error:
        return Step(run, Action.REFUSE, str(error))
    action, manifest = _ACTIONS[found.state], found.manifest
    if action is Action.LEAVE:
        if backend.adopt(run.path) is None:
            return Step(run, action, f"by {found.holder}")
        action = Action.RESUME  # a job of the backend's own is waited for
    detail = ""
    if action is Action.RETRY:
        why = (manifest.get("error") or {}).get("message", "no reason given")
        detail = f"{why} (step {manifest['steps']})"
    elif found.lost:
        detail = f"{found.lost}: from its last checkpoint"
    elif action is Action.RESUME:
        detail = f"from step {manifest['steps']} of {manifest['total_steps']}"
    return Step(run, action, detail)


def _show(steps: Sequence[Step], console: Console) -> None:
    """Print how many runs are of which kind, and each partial, failed, held or damaged one by name."""

    def say(text: str) -> None:
        console.print(text, soft_wrap=True, highlight=False, markup=False)

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
    """Bring every run to its end as far as it can be brought; a damaged one costs no other.

    Args:
        runs: frozen run directories, each once.
        backend: where they are carried out.
        console: where the tables go; standard output by default.
        check: looks further than at the manifest, and raises a RunError where a run is damaged.

    Raises:
        SubmitError: the backend refuses even the only run it has.
        UserError: the backend cannot work here.
    """
    console = console or Console()
    steps = [_step(run, backend, check) for run in runs]
    _show(steps, console)
    todo = [step.run for step in steps if step.action in (Action.RESUME, Action.START, Action.RETRY)]
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
    # Imported here: `auvbench resume` of complete runs needs none of it.
    from auvbench.runs.plan import Plan, freeze_all, plan
    from auvbench.training.execute import check_runnable

    distinct: dict[Path, Plan] = {}
    for planned in map(plan, configs):
        distinct.setdefault(planned.run.path, planned)
    for planned in distinct.values():
        check_runnable(planned.config)
    learning = any(learns(planned.config.algo) for planned in distinct.values())
    chosen = backend(configs[0].launcher, target=target, learning=learning)
    if any(config.launcher != configs[0].launcher for config in configs):
        raise ConfigError("launcher: a grid has one launcher; it cannot be an axis")
    runs = freeze_all(list(distinct.values()), command)
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
    from omegaconf import OmegaConf

    options = OmegaConf.to_object(launcher)
    if not isinstance(options, Launcher):
        raise ConfigError("launcher: its file must start from a schema (see conf/launcher)")
    # Imported when chosen: each backend has needs of its own.
    spec = LAUNCHERS.choose(options.name)
    if not isinstance(options, LauncherConfig):
        own: Backend = resolve(spec.code)(options, target, learning)
        return own
    who = f"launcher={options.name} of {options.package}"
    with telling(who, "cannot be made"):
        made: Backend = resolve(spec.code)(options, target, learning)
    needed = ("limit", "submit", "adopt", "wait", "close")
    if lacking := [name for name in needed if not hasattr(made, name)]:
        raise AgentError(
            f"{who}: what it makes, a {type(made).__name__}, lacks {', '.join(lacking)} (auvbench.scheduling.loop.Backend)"
        )
    return made

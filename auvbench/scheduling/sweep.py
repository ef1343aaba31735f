"""A whole sweep: look at what is there, say so, carry out the rest, sum up."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rich.console import Console

from auvbench.runs.directory import RunDirectory
from auvbench.scheduling import plan, views
from auvbench.scheduling.base import Backend
from auvbench.scheduling.loop import Loop, Outcome, Result


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
        check: as in `plan.make`; runs that were frozen just now need none.

    Raises:
        SubmitError: the backend refuses even the only run it has.
        UserError: the backend cannot work here.
    """
    console = console or Console()
    steps = plan.make(runs, watched=lambda path: backend.adopt(path) is not None, check=check)
    plan.show(steps, console)
    todo = steps.todo
    result = Result()
    if todo:
        view = views.view(todo, backend.limit, console)
        result = Loop(todo, backend, view).drive()
    else:
        backend.close()
    for step in steps.of(plan.Action.SKIP):
        result.outcomes[step.run.path] = (Outcome.COMPLETE, "")
    for step in steps.of(plan.Action.LEAVE):
        result.outcomes[step.run.path] = (Outcome.HELD, step.detail)
    for step in steps.of(plan.Action.REFUSE):
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

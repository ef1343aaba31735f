"""`auvbench runs --discard`: removes runs that were frozen and never begun."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from auvbench.errors import RunError, UserError

if TYPE_CHECKING:
    from auvbench.scheduling.listing import Row


def discard(rows: Sequence[Row], columns: Sequence[str] = (), *, ask: bool = True) -> int:
    """Shows the pending ones among the rows, asks, and removes them; others are never touched.

    Returns the exit code: 0 when they are gone or there were none, 1 when one could not be removed or the answer was no.
    """
    from auvbench.commands import runs_table
    from auvbench.runs.status import State

    pending = [row for row in rows if row.state is State.PENDING]
    if not pending:
        print(f"no pending run among {len(rows)}: nothing to discard")
        return 0
    runs_table.show(pending, of=len(rows), columns=columns)
    what = "this pending run" if len(pending) == 1 else f"these {len(pending)} pending runs"
    if ask:
        if not sys.stdin.isatty():
            raise UserError(f"--discard removes {what}: type --yes as well where there is no terminal to ask")
        try:
            answer = input(f"remove {what}? Nothing was trained in them. [y/N] ")
        except EOFError:
            answer = ""
        if answer.strip().lower() not in ("y", "yes"):
            print("kept")
            return 1
    removed = 0
    for row in pending:
        try:
            _remove(Path(row.path))
            removed += 1
        except (RunError, OSError) as error:
            reason = error.strerror if isinstance(error, OSError) and error.strerror else error
            print(f"auvbench: {row.path}: not removed: {reason}", file=sys.stderr)
    print(f"{removed} run{'s' if removed != 1 else ''} removed")
    return 0 if removed == len(pending) else 1


def _remove(path: Path) -> None:
    """With the run's lock held, and only if it is still pending: another process may have begun it meanwhile."""
    from auvbench.runs import lock
    from auvbench.runs.directory import RunDirectory

    run = RunDirectory(path)
    with lock.acquire(path):
        if run.manifest()["state"] != "pending":
            raise RunError("it has been begun meanwhile")
        if (path / "slurm.json").exists():
            raise RunError("it was submitted to SLURM: cancel its job and remove the folder by hand")
        # Out of sight at once: a removal that is interrupted half way leaves no damaged run.
        doomed = path.with_name(f".{path.name}.discarded")
        path.rename(doomed)
    shutil.rmtree(doomed)

"""`--trust`: use a run or study that another person made, in a command that does with your rights what it says."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from auvbench.errors import RunError, UserError

if TYPE_CHECKING:
    from auvbench.runs.directory import RunDirectory

FLAG = "--trust"
HELP = "use what another person made, which is like running that person's program; asked once for each folder"


def take(arguments: Sequence[str]) -> tuple[list[str], bool]:
    """Return the words without `--trust`, and whether it was among them.

    >>> take(["outputs", "--trust"])
    (['outputs'], True)
    """
    return [word for word in arguments if word != FLAG], FLAG in arguments


def require_runs(runs: Iterable[RunDirectory], given: bool, command: str, *, packages: bool = False) -> None:
    """As `require`, for runs; those that are damaged are left to the command.

    Args:
        runs: run directories.
        given: whether `--trust` was typed.
        command: its name.
        packages: only runs whose agent or simulator an installed package brings.
    """
    from auvbench.config import installed

    files = []
    for run in runs:
        try:
            config = run.check()
        except RunError:
            continue
        if not packages or installed.releases_of(config):
            files.append(run.config_path)
    require(files, given, command)


def require(files: Iterable[Path], given: bool, command: str) -> None:
    """Ask once before a command uses what another person made.

    Args:
        files: config.yaml of runs, study.json of studies.
        given: whether `--trust` was typed.
        command: its name.

    Raises:
        UserError: the answer is no, or no terminal can be asked.
    """
    from auvbench.runs import lock

    foreign = [file for file in files if not lock.is_own(file)]
    if not foreign:
        return
    more = f" and {len(foreign) - 1} more" if len(foreign) > 1 else ""
    what = f"{foreign[0].parent}{more}: not made by you, and {command} does with your rights what it says"
    if not given and not _confirmed(what):
        raise UserError(f"{what}; read {foreign[0].name}, then add {FLAG}")
    for file in foreign:
        lock.sign(file)


def _confirmed(what: str) -> bool:
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        return False
    print(f"{what}. Go on? [y/N] ", end="", file=sys.stderr, flush=True)
    return sys.stdin.readline().strip().lower() in ("y", "yes")

"""Calling the command line in this process, with what would take long left out, and judging what it says."""

from __future__ import annotations

import contextlib
import io
import os
import signal
import sys
import traceback
import unicodedata
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

from auvbench import cli
from auvbench.errors import RunError

PATIENCE = 60  # s of the processor that a command may take; waiting for it counts less
LONGEST = 6000  # characters of a message


@dataclass(frozen=True)
class Said:
    """What a command left."""

    code: int
    out: str
    err: str


class Hang(BaseException):
    """A command did not come back."""


def call(arguments: Sequence[str]) -> Said:
    """Runs a command; a defect comes out as the error that it is."""
    out, err = io.StringIO(), io.StringIO()
    defects: list[BaseException] = []

    def keep(error: BaseException, _: object) -> None:
        defects.append(error)

    def late(_number: int, _frame: FrameType | None) -> None:
        raise Hang(f"auvbench {' '.join(arguments)[:500]}")

    before = cli._save
    cli._save = keep  # type: ignore[assignment]
    former = [signal.signal(number, late) for number in (signal.SIGPROF, signal.SIGALRM)]
    signal.setitimer(signal.ITIMER_PROF, PATIENCE)
    signal.alarm(10 * PATIENCE)
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            code = cli.main(list(arguments))
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.alarm(0)
        for number, handler in zip((signal.SIGPROF, signal.SIGALRM), former, strict=True):
            signal.signal(number, handler)
        cli._save = before
    if defects:
        trace = "".join(traceback.format_exception(defects[0]))
        raise AssertionError(f"auvbench {list(arguments)!r} with an unexpected error:\n{trace}")
    return Said(code, out.getvalue(), err.getvalue())


def judge(arguments: Sequence[str]) -> Said:
    """Runs a command and checks its exit code, its message and what a terminal would obey."""
    said = call(arguments)
    assert said.code in (0, 1, 2, 3), f"{arguments!r}: exit code {said.code}: {said.err}"
    assert "Traceback" not in said.err + said.out, f"{arguments!r}: {said.err}"
    for line in said.err.splitlines():
        assert line.startswith("auvbench: ") or said.code != 2, f"{arguments!r}: {line!r}"
        assert len(line) <= LONGEST, f"{arguments!r}: a line of {len(line)} characters"
    if said.code == 2:
        assert said.err.strip(), f"{arguments!r}: exit code 2 and no word"
    # A character that Unicode has not assigned, or left to private use, is shown as a box and obeyed by nobody: --cfg
    # gives it back as it was typed.
    unseen = [c for c in said.err + said.out if not c.isprintable() and c not in "\n\t\u00a0\u202f\u2009"]
    odd = [c for c in unseen if unicodedata.category(c) not in ("Cn", "Co")]
    assert not odd, f"{arguments!r}: {odd[:5]!r} on the terminal"
    return said


@contextlib.contextmanager
def nothing_long(folder: Path) -> Iterator[None]:
    """In `folder`; training, testing and integrating end before they begin, with everything checked before."""
    from auvbench.commands import train
    from auvbench.evaluation import evaluate, rollout
    from auvbench.runs.plan import plan
    from auvbench.scheduling import grid
    from auvbench.simulators import openloop

    def refuse(*_: Any, **__: Any) -> Any:
        raise RunError("the fuzz test computes nothing")

    def checked(configs: Sequence[Any], _: str) -> Any:
        for config in configs[:3]:
            plan(config)
        refuse()

    patches: list[tuple[Any, str, Any]] = [
        (train, "carry_out", refuse),
        (grid, "sweep", refuse),
        (grid, "carry_out", checked),
        (evaluate, "_evaluate", refuse),
        (rollout, "roll_out", refuse),
        (openloop, "integrate", refuse),
    ]
    before = [(module, name, getattr(module, name)) for module, name, _ in patches]
    here, argv = os.getcwd(), sys.argv
    os.chdir(folder)
    for module, name, instead in patches:
        setattr(module, name, instead)
    try:
        yield
    finally:
        for module, name, original in before:
            setattr(module, name, original)
        os.chdir(here)
        sys.argv = argv

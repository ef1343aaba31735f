"""Carry out one run in one process: `python -m auvbench.training.worker RUN_DIR` trains or resumes a frozen
run directory.

Every backend starts this worker, so that a run is the same on every backend. The worker computes with one thread, holds
the run's lock, appends output to the run's `train/log.txt`, and writes an error into the run's manifest.

Exit codes: 0 complete, 1 failed (the manifest has the error), 2 no such run, 75 locked by another process,
130 or 143 interrupted by SIGINT or SIGTERM after saving.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import sys
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from auvbench import integrations, isolation, registry
from auvbench.errors import AuvbenchError, plain_warnings
from auvbench.runs import interruption, lock, status
from auvbench.runs.directory import RunDirectory, now
from auvbench.runs.error_file import is_foreign
from auvbench.runs.interruption import Interrupted, Request
from auvbench.runs.pool import ONE_THREAD
from auvbench.untrusted import path_safety, text

TARGET = "auvbench.training.execute:execute"
"""Function that a worker calls with the run directory, as module:function."""

HELD = 75
"""Exit code of a worker whose run is locked by another process (EX_TEMPFAIL of sysexits.h)."""

LOG = Path("train", "log.txt")

Target = Callable[[RunDirectory], Any]


def work(path: str | Path, *, target: str = TARGET, log: bool = False) -> int:
    """Carry out a run in this process and return the exit code; never raise."""
    plain_warnings()
    text.forgiving()
    try:
        run = RunDirectory(Path(path))
        path_safety.refuse_links(run.path)
        if log:
            redirect(run.path / LOG)
        with interruption.immediate() as request:
            print(f"[{now()}] worker, pid {os.getpid()} on {os.uname().nodename}", flush=True)
            carry_out(run, lambda run: _resolve(target)(run), request)
    except lock.RunHeldError as error:
        print(f"auvbench: {error}", file=sys.stderr)
        return HELD
    except AuvbenchError as error:
        if is_foreign(error):
            traceback.print_exc()
        print(f"auvbench: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt as error:
        return error.exit_code if isinstance(error, Interrupted) else 128 + signal.SIGINT
    except BaseException as error:
        if isinstance(error, OSError) and not Path(path).is_dir():
            print(f"auvbench: {path}: was renamed or removed; this process stops", file=sys.stderr)
        else:
            traceback.print_exc()
        return 1
    return 0


def carry_out(run: RunDirectory, function: Target, request: Request | None = None) -> None:
    """Call `function(run)` while this process holds the run's lock. Record an exception in the manifest before raising it.

    Args:
        run: run directory.
        function: function that carries out the run.
        request: result of `interruption.immediate` if that function handles the signals, else None.

    Raises:
        KeyboardInterrupt: the run was interrupted, even if a library raised another error instead.
    """
    jobs = (registry.resolve(code)() for code in integrations.JOBS)
    with lock.acquire(run.path, job=next(filter(None, jobs), None)):
        if status.finished(run):  # another process has finished it meanwhile
            return
        try:
            function(run)
        except lock.LockLostError:
            raise  # the manifest belongs to another process now
        except BaseException as error:
            interrupted = interruption.cause(error)
            if interrupted is None and request is not None and request.signal is not None:
                interrupted = Interrupted(request.signal)
            if interrupted is not None:
                _interrupted(run)
                raise interrupted from (None if interrupted is error else error)
            with contextlib.suppress(OSError):  # on a full disk, report `error`, not the failed write
                if not (run.manifest()["state"] == "failed" and run.manifest()["error"]):
                    fail(run, error)  # the training loop has not recorded the failure
            raise


def _resolve(target: str) -> Target:
    function: Target = registry.resolve(target)
    if (torch := sys.modules.get("torch")) is not None:
        torch.set_num_threads(1)  # torch may have been imported with more threads
    return function


def _interrupted(run: RunDirectory) -> None:
    """Record an interruption in the manifest if the training loop has not recorded it."""
    with contextlib.suppress(OSError):
        if run.manifest()["state"] in ("pending", "running"):
            run.update_manifest(state="interrupted", ended=now())


class WorkerDied(Exception):
    """A worker ended without recording its end; another process records this error in the manifest."""


def fail(run: RunDirectory, error: BaseException) -> None:
    """Mark a run as failed in its manifest. The caller must hold the run's lock."""
    name = type(error).__name__
    detail = {
        "type": name,
        "message": str(error) or name,
        "step": run.manifest()["steps"],
        "traceback": "".join(traceback.format_exception(error)) if error.__traceback__ else None,
    }
    run.update_manifest(state="failed", ended=now(), error=detail)


def redirect(path: Path) -> None:
    """Append this process's stdout and stderr, including output of C libraries, to a file."""
    path.parent.mkdir(exist_ok=True)
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    for number in (1, 2):
        os.dup2(file, number)
    os.close(file)
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(line_buffering=True)  # the log must be readable while the run continues


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m auvbench.training.worker", description=__doc__)
    parser.add_argument("run", type=Path, help="a frozen run directory")
    parser.add_argument("--target", default=TARGET, help="module:function that carries out the run")
    parser.add_argument("--log", action="store_true", help="append output to the run's train/log.txt")
    parser.add_argument(
        "--parent", type=int, help="pid of the parent process; the worker is killed when the parent ends"
    )
    options = parser.parse_args(arguments)
    if options.parent is not None:
        interruption.die_with_parent(options.parent)
    os.environ.update(ONE_THREAD)
    with isolation.restored():
        try:
            isolation.isolate()
        except AuvbenchError as error:
            print(f"auvbench: {error}", file=sys.stderr)
            return error.exit_code
        return work(options.run, target=options.target, log=options.log)


if __name__ == "__main__":
    sys.exit(main())

"""Define the interface of a backend, and the loop that starts as many runs as the backend takes."""

from __future__ import annotations

import signal
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import islice
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, Protocol

from auvbench.errors import AgentError, PluginImportError, RunError, UserError
from auvbench.runs import interruption, lock
from auvbench.runs.directory import RunDirectory
from auvbench.runs.interruption import SIGNALS
from auvbench.runs.status import finished
from auvbench.training import worker
from auvbench.training.worker import HELD

if TYPE_CHECKING:
    from auvbench.scheduling.views import View


class SubmitError(UserError):
    """The backend refused a run; the message comes from the backend."""


class Phase(StrEnum):
    """State of a job; the run's manifest says whether the run succeeded."""

    QUEUED = "queued"
    RUNNING = "running"
    ENDED = "ended"


@dataclass(frozen=True, slots=True)
class Status:
    """Status of a job, as far as the backend knows it."""

    phase: Phase
    code: int | None = None  # exit code of an ended job, negative for a signal, None if unknown
    reason: str = ""  # reason in the backend's words, if the backend knows more than the exit code
    # True if the job ended because its node or server died, so that another try of the run may succeed
    lost: bool = False

    @property
    def ended(self) -> bool:
        return self.phase is Phase.ENDED

    def describe(self) -> str:
        """Return how the job ended, as text: `killed by signal 9 (SIGKILL), possibly out of memory`."""
        if self.code is None:
            return self.reason or "ended for an unknown reason"
        if self.code >= 0:
            return self.reason or f"ended with exit code {self.code}"
        try:
            name = signal.Signals(-self.code).name
        except ValueError:
            name = "unknown"
        hint = ", possibly out of memory" if -self.code == signal.SIGKILL else ""
        more = f" ({self.reason})" if self.reason else ""
        return f"killed by signal {-self.code} ({name}){hint}{more}"


class Job(Protocol):
    """A run directory that was submitted to a backend."""

    run: Path

    @property
    def mark(self) -> str | None:
        """Return the job's name in the run's lock file while the job's worker holds the lock, e.g. `slurm:17`.

        None for a backend whose jobs have no such name.
        """

    def poll(self) -> Status:
        """Return the present status; cheap enough to call several times a second."""

    def cancel(self, *, force: bool = False) -> None:
        """Ask the worker to save and exit; with `force`, kill it. An ended job is not affected."""

    def __str__(self) -> str:
        """Return the job's identity as text: `pid 4711`, `slurm job 17`."""


class Backend(Protocol):
    """A place that carries out runs."""

    limit: int | None  # largest number of simultaneous jobs; None: no limit, the backend has its own queue

    def submit(self, run: Path) -> Job:
        """Start `python -m auvbench.training.worker RUN` on the backend.

        Raises:
            SubmitError: the backend refuses the run now.
            UserError: the backend can never work here (a missing command or package).
        """

    def adopt(self, run: Path) -> Job | None:
        """Return the queued or running job that an earlier sweep started for this run; None without such a job."""

    def wait(self, seconds: float) -> None:
        """Return after `seconds`, or earlier if the status of a job may have changed."""

    def close(self) -> None:
        """Stop the processes that the backend itself started; jobs of an external cluster continue."""


_FOREIGN = (AgentError.__name__, PluginImportError.__name__)
"""Types of errors that the code of an installed package raises"""

TICK = 0.25  # s between two polls of the jobs
MANY = 100  # largest number of runs that are submitted one by one to a backend with arrays
TRIES = 3  # largest number of starts of a run if its node or server dies


class Outcome(StrEnum):
    """Outcome of a run in this sweep."""

    COMPLETE = "complete"
    FAILED = "failed"
    INTERRUPTED = "interrupted"
    HELD = "locked"
    NOT_STARTED = "not started"


@dataclass(slots=True)
class Result:
    """Outcomes of all runs."""

    outcomes: dict[Path, tuple[Outcome, str]] = field(default_factory=dict)
    signal: signal.Signals | None = None  # signal that ended the sweep early

    def of(self, outcome: Outcome) -> dict[Path, str]:
        """Return the runs with this outcome: message by run."""
        return {run: message for run, (result, message) in self.outcomes.items() if result is outcome}

    @property
    def exit_code(self) -> int:
        """Return 128 + signal if interrupted, 0 if all runs are complete, else 1."""
        if self.signal is not None:
            return 128 + self.signal
        return 0 if all(outcome is Outcome.COMPLETE for outcome, _ in self.outcomes.values()) else 1


def largest_array(backend: Backend) -> int:
    """Return the largest number of runs that `backend.submit_array` submits at once; 0 for a backend without arrays."""
    return int(getattr(backend, "largest_array", 0))


class Loop:
    """Loop of one sweep."""

    def __init__(self, runs: Sequence[RunDirectory], backend: Backend, view: View) -> None:
        self.waiting = deque(runs)
        self.backend = backend
        self.view = view
        self.active: dict[Job, RunDirectory] = {}
        self.tries: dict[Path, int] = {}
        self.result = Result()
        self._refused = False  # whether the backend refused an array
        self.signals = 0  # signals received
        self._obeyed = 0  # signals passed on to the workers

    def drive(self) -> Result:
        """Carry out the runs until each has an outcome.

        Raises:
            SubmitError: the backend refuses a run although no other run is active.
            UserError: the backend cannot work here.
        """
        self.view.begin()
        try:
            with interruption.handlers(self._note):
                while self.goes_on():
                    self._obey()
                    self._fill()
                    self.backend.wait(TICK)
                    self._collect()
                    self.view.refresh()
        finally:
            self.view.end()
            self.backend.close()
        return self.result

    def goes_on(self) -> bool:
        """Return whether a run is still waiting or active."""
        return bool(self.waiting or self.active)

    def _room(self) -> int:
        """Return how many of the waiting runs the backend takes now."""
        limit = self.backend.limit
        return len(self.waiting) if limit is None else min(len(self.waiting), limit - len(self.active))

    def _fill(self) -> None:
        if not self._refused:
            self._fill_arrays()
        while self._room() > 0:
            run = self.waiting[0]
            try:
                job = self.backend.adopt(run.path) or self.backend.submit(run.path)
            except SubmitError:
                if not self.active:
                    raise
                return  # perhaps the cluster limits the number of jobs: try again when a job has ended
            except OSError as error:  # the run's directory is gone or not writable
                self.waiting.popleft()
                self._settle(run, Outcome.FAILED, f"could not be started: {error}")
                continue
            self.waiting.popleft()
            self._begun(run, job)

    def _fill_arrays(self) -> None:
        """Submit many runs at once if the backend has arrays. After a refused array, `_fill` submits the runs one by one."""
        backend: Any = self.backend
        while (largest := largest_array(backend)) and self._room() > MANY:
            runs = {run.path: run for run in islice(self.waiting, min(largest, self._room()))}
            adopted = {path: job for path in runs if (job := backend.adopt(path))}
            try:
                jobs = adopted | backend.submit_array([path for path in runs if path not in adopted])
            except SubmitError:
                self._refused, jobs = True, adopted
            self.waiting = deque(run for run in self.waiting if run.path not in jobs)
            for path, job in jobs.items():
                self._begun(runs[path], job)
            if not jobs or self._refused:
                return

    def _begun(self, run: RunDirectory, job: Job) -> None:
        self.tries[run.path] = self.tries.get(run.path, 0) + 1
        self.active[job] = run
        self.view.started(run, job)

    def _collect(self) -> None:
        for job, run in list(self.active.items()):
            status = job.poll()
            if not status.ended:
                self.view.polled(run, status.phase)
                continue
            del self.active[job]
            if status.lost and not self.signals and self.tries[run.path] < TRIES:
                self.view.say(f"{run.path.name}: {status.describe()}; it is resumed")
                self.waiting.appendleft(run)
                continue
            try:
                outcome, message = judge(run, job, status, cancelled=self.signals > 0)
            except RunError as error:  # the run was removed or damaged meanwhile
                outcome, message = Outcome.FAILED, str(error)
            self._settle(run, outcome, message)

    def _settle(self, run: RunDirectory, outcome: Outcome, message: str) -> None:
        self.result.outcomes[run.path] = (outcome, message)
        self.view.ended(run, outcome, message)

    def _obey(self) -> None:
        """Pass signals on to the workers: the first asks them to save, the second kills them."""
        if self.signals == self._obeyed:
            return
        self._obeyed = self.signals
        force = self.signals > 1
        for run in self.waiting:
            self._settle(run, Outcome.NOT_STARTED, "")
        self.waiting.clear()
        if self.active:
            verb = "are killed" if force else "save and exit; a second signal kills them"
            self.view.say(f"interrupted: the {len(self.active)} active runs {verb}")
        for job, run in list(self.active.items()):
            job.cancel(force=force)
            if force and job.mark is not None:  # a cluster may take minutes to report that the job has ended
                del self.active[job]
                self._settle(run, Outcome.INTERRUPTED, f"{job} gets the signal to end")

    def _note(self, number: int, _frame: FrameType | None) -> None:
        self.signals += 1
        self.result.signal = self.result.signal or signal.Signals(number)


def judge(run: RunDirectory, job: Job, status: Status, *, cancelled: bool) -> tuple[Outcome, str]:
    """Return the outcome of a run whose job has ended; if the worker failed without recording it in the manifest, record the failure."""
    manifest = run.manifest()
    state = manifest["state"]
    if finished(run, manifest):
        return Outcome.COMPLETE, ""
    if status.code == HELD:
        return Outcome.HELD, f"locked by {lock.current(run.path) or 'a process that has ended by now'}"
    # If the job was killed, an error in the manifest is from an earlier attempt.
    if state == "failed" and manifest["error"] and (status.code is None or status.code > 0):
        log = (
            "; its traceback is in " + str(run.train / "log.txt")
            if manifest["error"]["type"] in _FOREIGN
            else ""
        )
        return Outcome.FAILED, f"{manifest['error']['message']}{log}"
    if cancelled or status.code in {128 + number for number in SIGNALS}:
        if state == "pending":
            return Outcome.INTERRUPTED, "stopped before it started"
        return Outcome.INTERRUPTED, f"saved at step {manifest['steps']}"
    if state == "interrupted" and status.code is None:
        return Outcome.INTERRUPTED, status.describe()
    message = status.describe() if status.code != 0 else "ended with exit code 0, but the run is not complete"
    if status.code is not None and status.code >= 0:
        message = f"{message}; {run.train / 'log.txt'} may say why"
    try:
        with lock.acquire(run.path):
            worker.fail(run, worker.WorkerDied(message))
    except lock.RunHeldError as held:
        if (
            job.mark is not None and held.holder.job == job.mark
        ):  # the job's node died, and the file server has not yet freed the lock of this job
            return Outcome.FAILED, message
        return Outcome.HELD, f"{message}; taken over by {held.holder}"
    except (RunError, OSError) as error:
        message = f"{message}; its manifest could not be written ({error})"
    return Outcome.FAILED, message

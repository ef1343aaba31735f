"""The interface of the places where runs are carried out, and the loop: as many runs at once as a place takes."""

from __future__ import annotations

import signal
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Protocol

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
    """The backend refused a run; the message is the backend's own."""


class Phase(StrEnum):
    """Where a job is; whether its run succeeded is in the run's manifest, not here."""

    QUEUED = "queued"
    RUNNING = "running"
    ENDED = "ended"


@dataclass(frozen=True, slots=True)
class Status:
    """What a backend knows about a job."""

    phase: Phase
    code: int | None = None  # exit code of an ended job, negative for a signal, None where it is unknown
    reason: str = ""  # in the backend's words, where it knows more than the code
    lost: bool = False  # ended through no doing of the run (its node or its server died): worth another try

    @property
    def ended(self) -> bool:
        return self.phase is Phase.ENDED

    def describe(self) -> str:
        """How the job ended, for people: `killed by signal 9 (SIGKILL), possibly out of memory`."""
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
    """A run directory that a backend has been given."""

    run: Path

    @property
    def mark(self) -> str | None:
        """How the run's lock names this job when a worker of it holds it (`slurm:17`), if it does."""

    def poll(self) -> Status:
        """Where it is now; cheap enough to be called several times a second."""

    def cancel(self, *, force: bool = False) -> None:
        """Asks the worker to save and leave; with `force` kills it. Ended jobs are left alone."""

    def __str__(self) -> str:
        """Where it runs, for people: `pid 4711`, `slurm job 17`."""


class Backend(Protocol):
    """A place that carries out runs."""

    limit: int | None  # how many jobs it takes at once; None: as many as there are, it has a queue itself

    def submit(self, run: Path) -> Job:
        """Starts `python -m auvbench.training.worker RUN` there.

        Raises:
            SubmitError: it is refused, now.
            UserError: this backend can never work here (a missing command or package).
        """

    def adopt(self, run: Path) -> Job | None:
        """A job of this run that an earlier sweep started here and that is still queued or running."""

    def wait(self, seconds: float) -> None:
        """Returns after so long, or earlier when a job may have changed."""

    def close(self) -> None:
        """Ends what the backend itself started; jobs of an outside cluster go on."""


_FOREIGN = (AgentError.__name__, PluginImportError.__name__)
"""Types of errors that the code of an installed package causes"""

TICK = 0.25  # s between two looks at the jobs
TRIES = 3  # how often a run is started whose node or server died under it


class Outcome(StrEnum):
    """What became of a run in this sweep."""

    COMPLETE = "complete"
    FAILED = "failed"
    INTERRUPTED = "interrupted"
    HELD = "held"
    NOT_STARTED = "not started"


@dataclass(slots=True)
class Result:
    """What became of all runs."""

    outcomes: dict[Path, tuple[Outcome, str]] = field(default_factory=dict)
    signal: signal.Signals | None = None  # what ended the sweep early

    def of(self, outcome: Outcome) -> dict[Path, str]:
        """The runs with this outcome and the message of each."""
        return {run: message for run, (found, message) in self.outcomes.items() if found is outcome}

    @property
    def exit_code(self) -> int:
        """128 + signal when interrupted, 0 when all runs are complete, else 1."""
        if self.signal is not None:
            return 128 + self.signal
        return 0 if all(outcome is Outcome.COMPLETE for outcome, _ in self.outcomes.values()) else 1


class Loop:
    """Drives one sweep."""

    def __init__(self, runs: Sequence[RunDirectory], backend: Backend, view: View) -> None:
        self.waiting = deque(runs)
        self.backend = backend
        self.view = view
        self.active: dict[Job, RunDirectory] = {}
        self.tries: dict[Path, int] = {}
        self.result = Result()
        self.signals = 0  # how many have come
        self._obeyed = 0  # how many have been passed on

    def drive(self) -> Result:
        """Until every run has an outcome.

        Raises:
            SubmitError: the backend refuses a run although it has nothing else to do.
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
        """Whether anything is left to do."""
        return bool(self.waiting or self.active)

    def _fill(self) -> None:
        while self.waiting and (self.backend.limit is None or len(self.active) < self.backend.limit):
            run = self.waiting[0]
            try:
                job = self.backend.adopt(run.path) or self.backend.submit(run.path)
            except SubmitError:
                if not self.active:
                    raise
                return  # a limit of the cluster, perhaps: again when a job has ended
            except OSError as error:  # its directory has gone or takes nothing more
                self.waiting.popleft()
                self._settle(run, Outcome.FAILED, f"could not be started: {error}")
                continue
            self.waiting.popleft()
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
            except RunError as error:  # it was removed or damaged meanwhile
                outcome, message = Outcome.FAILED, str(error)
            self._settle(run, outcome, message)

    def _settle(self, run: RunDirectory, outcome: Outcome, message: str) -> None:
        self.result.outcomes[run.path] = (outcome, message)
        self.view.ended(run, outcome, message)

    def _obey(self) -> None:
        """Passes signals on to the workers: the first as a request, the second as an end."""
        if self.signals == self._obeyed:
            return
        self._obeyed = self.signals
        force = self.signals > 1
        for run in self.waiting:
            self._settle(run, Outcome.NOT_STARTED, "")
        self.waiting.clear()
        if self.active:
            verb = "are killed" if force else "save and leave; once more kills them"
            self.view.say(f"interrupted: the {len(self.active)} running {verb}")
        for job, run in list(self.active.items()):
            job.cancel(force=force)
            if force and job.mark is not None:  # a cluster may take minutes to say that the job has ended
                del self.active[job]
                self._settle(run, Outcome.INTERRUPTED, f"{job} is told to end")

    def _note(self, number: int, _frame: FrameType | None) -> None:
        self.signals += 1
        self.result.signal = self.result.signal or signal.Signals(number)


def judge(run: RunDirectory, job: Job, status: Status, *, cancelled: bool) -> tuple[Outcome, str]:
    """What became of a run whose job has ended; a death it could not record itself is recorded for it."""
    manifest = run.manifest()
    state = manifest["state"]
    if finished(run, manifest):
        return Outcome.COMPLETE, ""
    if status.code == HELD:
        return Outcome.HELD, f"held by {lock.current(run.path) or 'a process that has ended by now'}"
    # An error in the manifest of a job that was killed is that of an earlier attempt.
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
    message = status.describe() if status.code != 0 else "ended without an error and without being complete"
    if status.code is not None and status.code >= 0:
        message = f"{message}; {run.train / 'log.txt'} may say why"
    try:
        with lock.acquire(run.path):
            worker.fail(run, worker.WorkerDied(message))
    except lock.RunHeldError as held:
        if (
            job.mark is not None and held.holder.job == job.mark
        ):  # its node died; the file server has yet to notice
            return Outcome.FAILED, message
        return Outcome.HELD, f"{message}; taken over by {held.holder}"
    except (RunError, OSError) as error:
        message = f"{message}; its manifest could not be written ({error})"
    return Outcome.FAILED, message

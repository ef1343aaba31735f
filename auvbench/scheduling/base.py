"""The small interface between the scheduling loop and the places where runs are carried out."""

from __future__ import annotations

import signal
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Protocol

from auvbench.errors import UserError


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

    name: str
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

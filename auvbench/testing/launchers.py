"""Check launchers."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from omegaconf import DictConfig

from auvbench.config.compose import compose
from auvbench.runs.directory import RunDirectory
from auvbench.runs.plan import prepare
from auvbench.scheduling.grid import backend
from auvbench.scheduling.loop import Backend, Job, Status
from auvbench.testing.draws import ConformanceError, failing, run_checks

WAIT = 600.0
"""Largest duration of a run in a check, s"""


@dataclass
class Launches:
    """Runs of a controller in a separate folder, and the backends that carry them out."""

    overrides: tuple[str, ...]
    folder: Path
    _backends: list[Backend] = field(default_factory=list)

    def config(self, name: str, *more: str) -> DictConfig:
        words = ["algo=pid", *self.overrides, *more, f"output={self.folder}", f"name={name}"]
        return compose("train", words)

    def run(self, name: str, *more: str) -> RunDirectory:
        """Return a run that has not started."""
        return prepare(self.config(name, *more))

    def backend(self) -> Backend:
        instance = backend(self.config("any").launcher, learning=False)
        self._backends.append(instance)
        return instance

    def close(self) -> None:
        for instance in self._backends:
            instance.close()


def until_ended(place: Backend, job: Job) -> Status:
    """Wait until a job has ended, and return its status."""
    end = time.monotonic() + WAIT
    while time.monotonic() < end:
        if (status := job.poll()).ended:
            return status
        place.wait(0.1)
    raise ConformanceError(f"{job} has not ended after {WAIT:g} s; its phase is {job.poll().phase}")


def it_carries_runs_out(launches: Launches) -> None:
    """Check that `submit` returns a job of the submitted run, and that the run ends complete with exit code 0."""
    place = launches.backend()
    runs = [launches.run("first", f"seed={seed}") for seed in (0, 1)]
    for run in runs:
        job = place.submit(run.path)
        if Path(job.run) != run.path:
            raise ConformanceError(
                f"submit({run.path}) returns a job of the run {job.run}; it must be a job of the submitted run"
            )
        status = until_ended(place, job)
        if status.code not in (0, None) or run.manifest()["state"] != "complete":
            raise ConformanceError(
                f"a run's state is {run.manifest()['state']}, and its job {status.describe()}; the state must be complete"
            )


def it_reports_a_run_that_fails(launches: Launches) -> None:
    """Check that the job of a folder without a run ends with an exit code other than 0."""
    place = launches.backend()
    (launches.folder / "empty").mkdir()
    status = until_ended(place, place.submit(launches.folder / "empty"))
    if status.code == 0:
        raise ConformanceError(
            "the job of a folder without a run ended with exit code 0; the code must not be 0"
        )


def an_ended_job_stays_as_it_is(launches: Launches) -> None:
    """Check that polling or cancelling an ended job changes nothing, and that `adopt` returns None for an ended run."""
    place = launches.backend()
    run = launches.run("ended")
    job = place.submit(run.path)
    status = until_ended(place, job)
    job.cancel()
    job.cancel(force=True)
    if job.poll() != status:
        raise ConformanceError(f"cancel must not change an ended job; it is {job.poll()} and was {status}")
    if run.manifest()["state"] != "complete":
        raise ConformanceError("cancel must not change a run that has ended")
    if (adopted := place.adopt(run.path)) is not None:
        raise ConformanceError(f"adopt returns {adopted} for a run that has ended; it must return None")


def it_closes_twice(launches: Launches) -> None:
    """Check that a backend can be closed before its first run, and can be closed twice."""
    place = launches.backend()
    place.close()
    place.close()


LAUNCHER_CHECKS: tuple[Callable[[Launches], None], ...] = (
    it_carries_runs_out,
    it_reports_a_run_that_fails,
    an_ended_job_stays_as_it_is,
    it_closes_twice,
)
"""Checks of every launcher."""


def check_launcher(*overrides: str, only: Callable[[Any], None] | None = None) -> None:
    """Check a launcher against its contract (`auvbench.scheduling.loop.Backend`).

    Args:
        overrides: arguments of `auvbench train`: the launcher, `launcher=NAME`, and its options.
        only: one of `LAUNCHER_CHECKS`; default: all.

    Raises:
        ConformanceError: the launcher breaks its contract.
        ConfigError: an override is wrong.
    """

    def call(check: Callable[[Launches], None]) -> None:
        with tempfile.TemporaryDirectory(prefix="auvbench-testing-") as folder:
            launches = Launches(overrides, Path(folder))
            with failing("the launcher"):
                try:
                    check(launches)
                finally:
                    launches.close()

    run_checks(LAUNCHER_CHECKS, only, overrides, call)

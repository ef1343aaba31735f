"""A run that learns, carried out: its learner on its environments, recorded, watched, resumed where it stopped."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench import tracking
from auvbench.agents.base import Learner, learner_of
from auvbench.config import schema
from auvbench.envs.batch import Batch, Transition
from auvbench.errors import TrainingError
from auvbench.record import record_columns
from auvbench.runs import integrity, lock
from auvbench.runs.atomic_io import fsync, storage
from auvbench.runs.directory import RunDirectory
from auvbench.runs.identity import digest_of
from auvbench.runs.interruption import Interrupted, Request
from auvbench.runs.lock import LockLostError
from auvbench.runs.progress import EpisodeLog, Reporter, Watch
from auvbench.training.checkpoint import logs
from auvbench.training.checkpoint.logs import EventWriter
from auvbench.training.checkpoint.saver import Checkpointer
from auvbench.training.validation import Validator

GRACE = 20.0  # s to reach the next checkpoint after SIGTERM; SLURM kills 30 s after it by default


@dataclass
class Session:
    """One training, as its learner sees it (`agents.base.Callbacks`)."""

    run: RunDirectory
    learner: Learner
    """the one that is saved and tested"""
    environment: Batch
    total_steps: int
    """the budget, in environment steps"""
    checkpointer: Checkpointer
    """prepared, with its parts"""
    episodes: EpisodeLog
    events: EventWriter
    reporter: Reporter
    validator: Validator | None
    stop: Request
    """looked at in every step"""
    steps: int = 0
    """environment steps that lie behind"""
    began_at: float | None = None
    """when training began, by the monotonic clock; None before `begin`"""
    _asked_at: float | None = None

    def begin(self) -> int:
        """As the contract says."""
        self.began_at = time.monotonic()
        self.steps = self.checkpointer.restore(self.learner)
        return self.steps

    def step(self, steps: int, transition: Transition) -> float:
        """As the contract says.

        Raises:
            TrainingError: an observation or a reward is not finite.
            Interrupted: the run was asked to stop, and no checkpoint can be waited for.
        """
        self.steps = steps
        check_step(transition.observation, transition.reward, steps)
        if self.stop.signal is not None:
            self._asked_at = self._asked_at or time.monotonic()
            if not self.learner.exact_resume or time.monotonic() - self._asked_at > GRACE:
                self._leave(self._kept())
        if transition.records:
            self.episodes.append(steps, transition.records)
            for record in transition.records:
                self.reporter.episode(record["outcome"] == "success", float(record["return"]))
        self.reporter.step(steps)
        if self.validator is not None and self.validator.is_due(steps, self.environment.n):
            return self._test(self.validator)
        return 0.0

    def _test(self, validator: Validator) -> float:
        elapsed = self.checkpointer.elapsed
        spent = validator.test(self.learner, self.steps, self.reporter.episodes, elapsed)
        self.checkpointer.paused += spent
        return spent

    def checkpoint(self, steps: int) -> None:
        """As the contract says.

        Raises:
            Interrupted: the run was asked to stop; it is saved.
        """
        self.steps = steps
        lock.verify(self.run.path, every=1.0)
        if self.stop.signal is not None:
            if self.learner.exact_resume:
                self.checkpointer.save(self.learner, steps)
                self._leave(f"saved at step {steps:,}")
            self._leave(self._kept())
        if self.learner.exact_resume and self.checkpointer.is_due(steps):
            self.checkpointer.save(self.learner, steps)

    def log(self, scalars: Mapping[str, float], steps: int) -> None:
        """As the contract says."""
        self.events.write(scalars, steps)

    def end(self) -> None:
        """Call when the learner has returned: saves the last checkpoint, and tests once more where that is owed.

        Raises:
            TrainingError: the budget is not used up.
        """
        if self.steps < self.total_steps:
            raise TrainingError(
                f"the learner returned at step {self.steps:,} of {self.total_steps:,}; it must go on until the budget is used up"
            )
        lock.verify(self.run.path)
        if self.learner.exact_resume:
            self.checkpointer.save(self.learner, self.steps)
        if self.validator is not None and self.validator.is_owed(self.steps, self.environment.n):
            self._test(self.validator)

    def _kept(self) -> str:
        if self.learner.exact_resume:
            return f"the last checkpoint is of step {self.checkpointer.saved_step:,}"
        return "which this learner cannot go on from: it begins anew"

    def _leave(self, what: str) -> None:
        assert self.stop.signal is not None
        cause = {"SIGINT": "Ctrl-C", "SIGTERM": "SIGTERM"}.get(self.stop.signal.name, self.stop.signal.name)
        goes_on = "; the same command goes on from there" if self.learner.exact_resume else ""
        raise Interrupted(self.stop.signal, f"{self.run.path}: stopped by {cause}, {what}{goes_on}")


def reached(steps: int, reporter: Reporter) -> dict[str, Any]:
    """What a manifest says of a training that has come so far."""
    return {"steps": steps, "episodes": reporter.episodes, "success_rate": reporter.success_rate}


def check_step(observations: NDArray[Any], rewards: NDArray[Any], step: int) -> None:
    """Raises `TrainingError` when what the environments returned in this step is not finite.

    Args:
        observations: (n, d), as the environments give them: no clipping has hidden an infinity.
        rewards: (n,), likewise.
        step: environment steps so far, for the message.
    """
    for what, values in (("observation", observations), ("reward", rewards)):
        fine = np.isfinite(values)
        if not fine.all():
            bad = ~fine
            environment = int(np.nonzero(bad)[0][0])
            value = values[bad][0]
            raise TrainingError(f"step {step}: the {what} of environment {environment} is {value}")


EPISODES = "train/episodes.csv"
EVENTS = f"train/{logs.NAME}"
VALIDATION = "train/validation.csv"


def learn(
    run: RunDirectory,
    config: schema.TrainConfig,
    watch: Watch | None,
    stop: Request,
    note: Callable[..., object],
) -> dict[str, Any]:
    """Trains the learner of a run, from its last checkpoint on; returns what its manifest is to say.

    Args:
        run: its frozen directory.
        config: its typed configuration.
        watch: called with each report of progress.
        stop: set to make the run save and stop.
        note: called after each checkpoint with entries for the manifest.

    Raises:
        TrainingError: a NaN, or a disk that is full, read-only or failing.
        Interrupted: `stop` was set; a checkpoint is written.
    """
    begun = time.monotonic()
    earlier: dict[str, float] = run.manifest().get("phases", {})  # of attempts that could still write it
    train = config.train
    checkpointer = Checkpointer(
        run.path,
        every_steps=train.checkpoint.steps,
        every_seconds=train.checkpoint.seconds,
        keep=train.checkpoint.keep,
        logs=(EPISODES, EVENTS, *((VALIDATION,) if train.evaluate_every else ())),
    )
    resumed = checkpointer.prepare()
    batch = Batch(config)
    learner = learner_of(config, batch.vehicle)
    reporter = Reporter(run.path / "progress.json", train.total_steps, watch)
    checkpointer.parts = {"environment": batch, "progress": reporter}
    validator: Validator | None = None
    _tell_what_is_lost(run, resumed.step if resumed else None, batch.exact_resume, learner)

    def phases(trained: float) -> dict[str, float]:
        ready = session.began_at or trained
        spent = {
            "setup_s": ready - begun,
            "training_s": trained - ready,
            "checkpoints_s": checkpointer.spent,
            **({"validation_s": validator.spent} if validator else {}),
            "saving_s": time.monotonic() - trained,
        }
        return {name: round(earlier.get(name, 0.0) + seconds, 3) for name, seconds in spent.items()}

    # The same in every attempt, but not in a run made anew.
    key = digest_of([run.id, run.manifest()["created"]], 32)
    tracker = tracking.start(train.log, key, run.config(), run.id)
    with storage(f"cannot write the records of {run.path}"):
        columns = record_columns(config.task.name)
        log = EpisodeLog(columns, run.path / EPISODES, keep=resumed.logs[EPISODES].bytes if resumed else None)
        writer = logs.EventWriter(run.train, tracker)
        if train.evaluate_every:
            validator = Validator(
                run.config(),
                train.evaluate_every,
                run.path / VALIDATION,
                resumed.logs[VALIDATION].bytes if resumed and VALIDATION in resumed.logs else None,
                writer.write,
            )
        session = Session(
            run,
            learner,
            batch,
            train.total_steps,
            checkpointer,
            log,
            writer,
            reporter,
            validator,
            stop,
        )
        checkpointer.flush = log.flush
        checkpointer.saved_hook = lambda: note(**reached(session.steps, reporter))
        try:
            learner.learn(batch, config, session)
            session.end()
            reporter.step(session.steps, force=True)
        except LockLostError:
            log.abandon()  # the files belong to another process by now
            raise
        except BaseException:
            with suppress(OSError):
                run.update_manifest(**reached(session.steps, reporter), phases=phases(time.monotonic()))
            raise
        finally:
            log.close()
            if validator is not None:
                validator.close()
            writer.close()
    trained = time.monotonic()
    with storage(f"cannot write {run.model}"):
        # On the disk before the manifest says so: a loss of power right after that leaves a whole run.
        written = [name for name in (EPISODES, EVENTS, VALIDATION) if (run.path / name).exists()]
        for name in written:
            fsync(run.path / name)
        fsync(run.train)
        files = run.write_model(_model(learner))
        files |= {name: integrity.entry_of(run.path / name) for name in written if name != EVENTS}
    return {**reached(session.steps, reporter), "files": files, "phases": phases(trained)}


def _tell_what_is_lost(run: RunDirectory, step: int | None, exact: bool, learner: Learner) -> None:
    """Names in the manifest what an attempt that begins now cannot bring back of the one before.

    `episodes_begun_again` lists the steps at which the simulator could not, `started_over` those that an attempt of a
    learner that cannot had reached.
    """
    manifest = run.manifest()
    if step is not None and not exact:
        run.update_manifest(episodes_begun_again=[*manifest.get("episodes_begun_again", []), step])
    if not learner.exact_resume and manifest["attempts"] > 1:
        lost = [*manifest.get("started_over", []), manifest["steps"]]
        run.update_manifest(started_over=lost, steps=0, episodes=0, success_rate=None)


def _model(learner: Learner) -> dict[str, bytes]:
    """The files of a trained learner, by name."""
    with tempfile.TemporaryDirectory(prefix="auvbench-model-") as folder:
        learner.save(Path(folder))
        return {path.name: path.read_bytes() for path in sorted(Path(folder).iterdir())}

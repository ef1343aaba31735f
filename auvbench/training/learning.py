"""Train a run: its learner on its environments, with records, progress, checkpoints and resume."""

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

GRACE = 20.0  # s to reach the next checkpoint after SIGTERM; by default, SLURM kills a job 30 s after SIGTERM


@dataclass
class Session:
    """Training of one run; its methods are the `agents.base.Callbacks` that the learner calls."""

    run: RunDirectory
    learner: Learner
    """learner that is saved and tested"""
    environment: Batch
    total_steps: int
    """budget in environment steps"""
    checkpointer: Checkpointer
    """checkpointer whose `prepare` was called and whose `parts` are set"""
    episodes: EpisodeLog
    events: EventWriter
    reporter: Reporter
    validator: Validator | None
    stop: Request
    """request to stop the run; each step checks it"""
    steps: int = 0
    """finished environment steps"""
    began_at: float | None = None
    """start of training by the monotonic clock; None before `begin`"""
    _stop_time: float | None = None

    def begin(self) -> int:
        """See `Callbacks.begin`."""
        self.began_at = time.monotonic()
        self.steps = self.checkpointer.restore(self.learner)
        return self.steps

    def step(self, steps: int, transition: Transition) -> float:
        """See `Callbacks.step`.

        Raises:
            TrainingError: an observation or a reward is not finite.
            Interrupted: a signal asked the run to stop, and the learner cannot save or reaches its next checkpoint too late.
        """
        self.steps = steps
        check_step(transition.observation, transition.reward, steps)
        if self.stop.signal is not None:
            self._stop_time = self._stop_time or time.monotonic()
            if not self.learner.exact_resume or time.monotonic() - self._stop_time > GRACE:
                self._leave(self._checkpoint_note())
        if records := transition.records[:: self.environment.team]:  # one record per team
            self.episodes.append(steps, records)
            for record in records:
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
        """See `Callbacks.checkpoint`.

        Raises:
            Interrupted: a signal asked the run to stop; a learner with exact resume is saved first.
        """
        self.steps = steps
        lock.verify(self.run.path, every=1.0)
        if self.stop.signal is not None:
            if self.learner.exact_resume:
                self.checkpointer.save(self.learner, steps)
                self._leave(f"saved at step {steps:,}")
            self._leave(self._checkpoint_note())
        if self.learner.exact_resume and self.checkpointer.is_due(steps):
            self.checkpointer.save(self.learner, steps)

    def log(self, scalars: Mapping[str, float], steps: int) -> None:
        """See `Callbacks.log`."""
        self.events.write(scalars, steps)

    def end(self) -> None:
        """Save the last checkpoint, and run a final validation if it is due. Call this method when the learner has
        returned.

        Raises:
            TrainingError: the learner returned before it had used up the budget.
        """
        if self.steps < self.total_steps:
            raise TrainingError(
                f"the learner returned at step {self.steps:,} of {self.total_steps:,}; it must continue "
                "until the budget is used up"
            )
        lock.verify(self.run.path)
        if self.learner.exact_resume:
            self.checkpointer.save(self.learner, self.steps)
        if self.validator is not None and self.validator.is_owed(self.steps, self.environment.n):
            self._test(self.validator)

    def _checkpoint_note(self) -> str:
        if self.learner.exact_resume:
            return f"the last checkpoint is of step {self.checkpointer.saved_step:,}"
        return "and this learner cannot resume: the same command starts its training from the beginning"

    def _leave(self, what: str) -> None:
        assert self.stop.signal is not None
        cause = {"SIGINT": "Ctrl-C", "SIGTERM": "SIGTERM"}.get(self.stop.signal.name, self.stop.signal.name)
        goes_on = "; run the same command to continue from it" if self.learner.exact_resume else ""
        raise Interrupted(self.stop.signal, f"{self.run.path}: stopped by {cause}, {what}{goes_on}")


def reached(steps: int, reporter: Reporter) -> dict[str, Any]:
    """Return the manifest entries that describe the progress of a training: steps, episodes and success rate."""
    return {"steps": steps, "episodes": reporter.episodes, "success_rate": reporter.success_rate}


def check_step(observations: NDArray[Any], rewards: NDArray[Any], step: int) -> None:
    """Raise `TrainingError` if the environments returned a value that is not finite in this step.

    Args:
        observations: (n, d) unclipped observations of the environments.
        rewards: (n,) unclipped rewards of the environments.
        step: environment steps so far, for the message.
    """
    for what, values in (("observation", observations), ("reward", rewards)):
        fine = np.isfinite(values)
        if not fine.all():
            invalid = ~fine
            environment = int(np.nonzero(invalid)[0][0])
            value = values[invalid][0]
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
    """Train the learner of a run from its last checkpoint on; return the entries for its manifest.

    Args:
        run: frozen directory of the run.
        config: configuration of the run.
        watch: function called with each report of progress.
        stop: request to save and stop; a signal sets it.
        note: function called after each checkpoint with entries for the manifest.

    Raises:
        TrainingError: an observation or a reward is not finite, the learner ended too early, or the disk is full, read-only or
            failing.
        Interrupted: `stop` was set. A learner with exact resume was saved first, unless it reached its next checkpoint too late.
    """
    begun = time.monotonic()
    # Total durations of the phases in earlier attempts. The manifest lacks the durations that an attempt did not write.
    earlier: dict[str, float] = run.manifest().get("phases", {})
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

    # The tracker's key is the same in every attempt of a run. If the run is removed and created again, the key changes.
    key = digest_of([run.id, run.manifest()["created"]], 32)
    tracker = tracking.start(train.log, key, run.config(), run.id)
    with storage(f"cannot write the records of {run.path}"):
        log = EpisodeLog(
            schema.columns_of(config),
            run.path / EPISODES,
            keep=resumed.logs[EPISODES].bytes if resumed else None,
        )
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
            log.abandon()  # the files belong to another process now
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
        # Sync the files to disk before the manifest records them: the run is then intact even after a power loss.
        written = [name for name in (EPISODES, EVENTS, VALIDATION) if (run.path / name).exists()]
        for name in written:
            fsync(run.path / name)
        fsync(run.train)
        files = run.write_model(_model(learner))
        files |= {name: integrity.entry_of(run.path / name) for name in written if name != EVENTS}
    return {**reached(session.steps, reporter), "files": files, "phases": phases(trained)}


def _tell_what_is_lost(run: RunDirectory, step: int | None, exact: bool, learner: Learner) -> None:
    """Record in the manifest what a resumed attempt cannot restore.

    `episodes_begun_again` lists the steps at which the run resumed with new episodes, since the simulator cannot restore its
    state. `started_over` lists the steps that a learner without exact resume had reached before it started over.
    """
    manifest = run.manifest()
    if step is not None and not exact:
        run.update_manifest(episodes_begun_again=[*manifest.get("episodes_begun_again", []), step])
    if not learner.exact_resume and manifest["attempts"] > 1:
        lost = [*manifest.get("started_over", []), manifest["steps"]]
        run.update_manifest(started_over=lost, steps=0, episodes=0, success_rate=None)


def _model(learner: Learner) -> dict[str, bytes]:
    """Return the content of the files that a trained learner saves, by name."""
    with tempfile.TemporaryDirectory(prefix="auvbench-model-") as folder:
        learner.save(Path(folder))
        return {path.name: path.read_bytes() for path in sorted(Path(folder).iterdir())}

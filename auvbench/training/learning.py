"""A run that learns, carried out: its learner on its environments, recorded, watched, resumed where it stopped."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from auvbench.agents.base import Learner, learner_of
from auvbench.config import schema, simulators
from auvbench.envs.batch import Batch
from auvbench.errors import ConfigError
from auvbench.record import record_columns
from auvbench.runs import integrity
from auvbench.runs.atomic_io import fsync_directory, fsync_file, storage
from auvbench.runs.directory import RunDirectory
from auvbench.runs.interruption import Request
from auvbench.runs.lock import LockLostError
from auvbench.runs.progress import EpisodeLog, Reporter, Watch
from auvbench.training.checkpoint import logs
from auvbench.training.checkpoint.saver import Checkpointer
from auvbench.training.session import Session, reached
from auvbench.training.validation import Validator

EPISODES = "train/episodes.csv"
EVENTS = f"train/{logs.NAME}"
VALIDATION = "train/validation.csv"


def learn(
    run: RunDirectory,
    config: schema.TrainConfig,
    watch: Watch | None = None,
    stop: Request | None = None,
    note: Callable[..., object] | None = None,
) -> dict[str, Any]:
    """Trains the learner of a run, from its last checkpoint on; returns what its manifest is to say.

    Args:
        run: its frozen directory.
        config: its typed configuration.
        watch: called with each report of progress.
        stop: set to make the run save and stop.
        note: called after each checkpoint with entries for the manifest; `run.update_manifest` by default.

    Raises:
        TrainingError: a NaN, or a disk that is full, read-only or failing.
        Interrupted: `stop` was set; a checkpoint is written.
    """
    begun = time.monotonic()
    earlier: dict[str, float] = run.manifest().get("phases", {})  # of attempts that could still write it
    train = config.train
    if train.evaluate_every and isinstance(config.simulator, simulators.Ros2):
        raise ConfigError(
            f"train.evaluate_every={train.evaluate_every}: with simulator=ros2 a test would take the server's vehicles away"
            " from the episodes in flight; leave it at 0"
        )
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

    with storage(f"cannot write the records of {run.path}"):
        columns = record_columns(config.task.name)
        log = EpisodeLog(columns, run.path / EPISODES, keep=resumed.logs[EPISODES].bytes if resumed else None)
        writer = logs.EventWriter(run.train)
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
            checkpointer=checkpointer,
            log=log,
            events=writer,
            reporter=reporter,
            validator=validator,
            stop=stop or Request(),
        )
        note = note or run.update_manifest
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
            fsync_file(run.path / name)
        fsync_directory(run.train)
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

"""The training loop of a learner: SB3 on the batch, normalised, recorded, watched, resumed where it stopped."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.vec_env import VecNormalize

from auvbench.agents.learned import learners
from auvbench.config import algorithms, schema
from auvbench.config.clock import discount
from auvbench.envs.sb3 import WaypointVecEnv
from auvbench.envs.sharded import make_batch
from auvbench.runs import integrity
from auvbench.runs.directory import RunDirectory
from auvbench.runs.durable import fsync_directory, fsync_file, storage
from auvbench.runs.interruption import Request
from auvbench.runs.lock import LockLostError
from auvbench.runs.progress import Reporter, Watch
from auvbench.runs.records import EpisodeLog
from auvbench.training.checkpoint import events, finite
from auvbench.training.checkpoint.callback import Checkpointer
from auvbench.training.validation import Validator

EPISODES = "train/episodes.csv"
EVENTS = f"train/{events.NAME}"
VALIDATION = "train/validation.csv"


class Recorder(BaseCallback):
    """Writes a row for each episode that ends and keeps the reporter informed."""

    def __init__(self, environment: WaypointVecEnv, log: EpisodeLog, reporter: Reporter) -> None:
        super().__init__()
        self._environment = environment
        self._log = log
        self._reporter = reporter

    def _on_step(self) -> bool:
        finished = self._environment.finished
        if finished:
            self._log.append(self.num_timesteps, finished)
            for record in finished:
                self._reporter.episode(record["outcome"] == "success", float(record["return"]))
        self._reporter.step(self.num_timesteps)
        return True


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
        stop: set by whoever wants the run to save and leave.
        note: called after each checkpoint with entries for the manifest; `run.update_manifest` by default.

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
        stop=stop,
    )
    resumed = checkpointer.prepare()
    batch = make_batch(config)
    environment = WaypointVecEnv(batch, detailed=False)
    normaliser = VecNormalize(
        environment,
        norm_obs=train.normalise_observations,
        norm_reward=train.normalise_rewards,
        clip_obs=train.clip_observations,
        clip_reward=train.clip_rewards,
        gamma=discount(config.algo, config.step.frequency),
    )
    model = learners.make(config, normaliser)
    reporter = Reporter(run.path / "progress.json", train.total_steps, watch)
    checkpointer.parts = {"environment": batch, "progress": reporter}
    validator: Validator | None = None
    if resumed is not None and not batch.exact_resume:
        begun_again = run.manifest().get("episodes_begun_again", [])
        run.update_manifest(episodes_begun_again=[*begun_again, resumed.step])
    ready = time.monotonic()

    def phases(trained: float) -> dict[str, float]:
        spent = {
            "setup_s": ready - begun,
            "training_s": trained - ready,
            "checkpoints_s": checkpointer.spent,
            **({"validation_s": validator.spent} if validator else {}),
            "saving_s": time.monotonic() - trained,
        }
        return {name: round(earlier.get(name, 0.0) + seconds, 3) for name, seconds in spent.items()}

    with storage(f"cannot write the records of {run.path}"):
        log = EpisodeLog(run.path / EPISODES, keep=resumed.logs[EPISODES].length if resumed else None)
        writer = events.EventWriter(run.train)
        model.set_logger(Logger(str(run.train), [writer]))
        callbacks: list[BaseCallback] = [checkpointer, Recorder(environment, log, reporter)]
        if train.evaluate_every:
            validator = Validator(
                run.config(),
                train.evaluate_every,
                run.path / VALIDATION,
                resumed.logs[VALIDATION].length if resumed and VALIDATION in resumed.logs else None,
                lambda: reporter.episodes,
                lambda rates, step: writer.write(rates, {}, step),
            )
            callbacks.append(validator)
        note = note or run.update_manifest
        checkpointer.flush = log.flush
        checkpointer.saved_hook = lambda: note(**_reached(model.num_timesteps, reporter))
        try:
            with finite.diagnosed(model):
                model.learn(
                    train.total_steps,
                    callback=callbacks,
                    log_interval=_log_interval(config),
                )
            reporter.step(model.num_timesteps, force=True)
        except LockLostError:
            log.abandon()  # the files are somebody else's by now
            raise
        except BaseException:
            with suppress(OSError):
                reached = _reached(model.num_timesteps, reporter)
                run.update_manifest(**reached, phases=phases(time.monotonic()))
            raise
        finally:
            log.close()
            if validator is not None:
                validator.close()
            model.logger.close()
    trained = time.monotonic()
    with storage(f"cannot write {run.model}"):
        # On the disk before the manifest says so: a loss of power right after that leaves a whole run.
        written = [name for name in (EPISODES, EVENTS, VALIDATION) if (run.path / name).exists()]
        for name in written:
            fsync_file(run.path / name)
        fsync_directory(run.train)
        files = run.write_model(learners.files(model, normaliser))
        files |= {name: integrity.entry_of(run.path / name) for name in written if name != EVENTS}
    return {**_reached(model.num_timesteps, reporter), "files": files, "phases": phases(trained)}


def _reached(steps: int, reporter: Reporter) -> dict[str, Any]:
    return {"steps": steps, "episodes": reporter.episodes, "success_rate": reporter.success_rate}


def _log_interval(config: schema.TrainConfig) -> int:
    """On-policy: every update. Off-policy: SB3 counts episodes there."""
    return 1 if isinstance(config.algo, algorithms.PPO) else 10

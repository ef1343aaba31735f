"""The training loop of a learner: SB3 on the batch, normalised, recorded, watched."""

from __future__ import annotations

import time
from typing import Any

from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.vec_env import VecNormalize

from auvbench.agents import learners
from auvbench.config import schema
from auvbench.envs.batch import Batch
from auvbench.envs.sb3 import WaypointVecEnv
from auvbench.runs.directory import RunDirectory
from auvbench.runs.progress import Reporter, Watch
from auvbench.runs.records import EpisodeLog


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


def learn(run: RunDirectory, config: schema.TrainConfig, watch: Watch | None) -> dict[str, Any]:
    """Trains the learner of a run; returns what its manifest is to say."""
    begun = time.monotonic()
    train = config.train
    environment = WaypointVecEnv(Batch(config))
    normaliser = VecNormalize(
        environment,
        norm_obs=train.normalise_observations,
        norm_reward=train.normalise_rewards,
        clip_obs=train.clip_observations,
        clip_reward=train.clip_rewards,
        gamma=config.algo.gamma,
    )
    model = learners.make(config, normaliser)
    model.set_logger(configure(str(run.train), ["tensorboard"]))
    log = EpisodeLog(run.train / "episodes.csv")
    reporter = Reporter(run.path / "progress.json", train.total_steps, watch)
    ready = time.monotonic()
    try:
        model.learn(
            train.total_steps,
            callback=Recorder(environment, log, reporter),
            log_interval=_log_interval(config),
        )
        reporter.step(model.num_timesteps, force=True)
    finally:
        log.flush(sync=True)
        log.close()
        model.logger.close()
    trained = time.monotonic()
    learners.save(model, normaliser, run.model)
    return {
        "steps": model.num_timesteps,
        "episodes": reporter.episodes,
        "success_rate": reporter.success_rate,
        "phases": {
            "setup_s": round(ready - begun, 3),
            "training_s": round(trained - ready, 3),
            "saving_s": round(time.monotonic() - trained, 3),
        },
    }


def _log_interval(config: schema.TrainConfig) -> int:
    """On-policy: every update. Off-policy: SB3 counts episodes there."""
    return 1 if isinstance(config.algo, schema.PPO) else 10

"""Trains a tiny learner on pendulums in a run directory, with checkpoints; returns every bit of the result."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from sb3_contrib import TQC, TRPO, CrossQ, RecurrentPPO
from stable_baselines3 import DDPG, PPO, SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.vec_env import VecNormalize

from auvbench.agents.learned import compiled, state
from auvbench.agents.learned.sb3 import Follower, SB3Learner, Scalars
from auvbench.training.checkpoint.logs import NAME, EventWriter
from auvbench.training.checkpoint.saver import Checkpointer
from auvbench.training.learning import check_step
from tests.soak.pendulum import Pendulums

LOGS = ("train/episodes.csv", f"train/{NAME}")
NET = {"net_arch": [16, 16]}


@dataclass(frozen=True)
class Case:
    """One learner: its class, how many environments, its hyperparameters."""

    algorithm: type[BaseAlgorithm]
    n: int
    options: dict[str, Any]
    noise: bool = False
    steps: int = 600
    network: dict[str, Any] = field(default_factory=dict)

    def build(self, seed: int) -> tuple[BaseAlgorithm, Pendulums]:
        batch = Pendulums(self.n, seed)
        options = dict(self.options)
        if self.noise:
            options["action_noise"] = NormalActionNoise(np.zeros(2), 0.2 * np.ones(2))
        env = VecNormalize(batch, gamma=0.99)
        policy = "MlpLstmPolicy" if self.algorithm is RecurrentPPO else "MlpPolicy"
        return self.algorithm(
            policy, env, seed=seed, device="cpu", policy_kwargs=NET | self.network, **options
        ), batch


OFF = {"batch_size": 16, "learning_starts": 40, "buffer_size": 300}
CASES = {
    "ppo-1": Case(PPO, 1, {"n_steps": 64, "batch_size": 32, "n_epochs": 2}),
    "ppo-8": Case(PPO, 8, {"n_steps": 16, "batch_size": 32, "n_epochs": 2}, steps=1500),
    "sac-1": Case(SAC, 1, OFF, steps=400),
    "sac-8": Case(SAC, 8, {**OFF, "train_freq": 4, "gradient_steps": 2}),
    "ddpg-1": Case(DDPG, 1, OFF, True, steps=300),
    "ddpg-8": Case(DDPG, 8, {**OFF, "gradient_steps": 2}, True),
    "td3-1": Case(TD3, 1, OFF, True, steps=300),
    "td3-8": Case(TD3, 8, {**OFF, "gradient_steps": -1}, True),
    "tqc-8": Case(TQC, 8, {**OFF, "gradient_steps": 2}, steps=480),
    # Its running statistics normalise from the 20th gradient step on.
    "crossq-8": Case(CrossQ, 8, {**OFF, "gradient_steps": 2}, steps=480, network={"renorm_warmup_steps": 20}),
    "compiled-sac-8": Case(compiled.SAC, 8, {**OFF, "train_freq": 4, "gradient_steps": 2}),
    "compiled-td3-8": Case(compiled.TD3, 8, {**OFF, "gradient_steps": 3}, "normal"),
    "compiled-tqc-8": Case(compiled.TQC, 8, {**OFF, "gradient_steps": 2}, steps=480),
    "compiled-crossq-8": Case(
        compiled.CrossQ, 8, {**OFF, "gradient_steps": 2}, steps=480, network={"renorm_warmup_steps": 20}
    ),
    "trpo-8": Case(TRPO, 8, {"n_steps": 16, "batch_size": 32, "n_critic_updates": 2}, steps=1200),
    # Rollouts end in the midst of episodes, of which the LSTM remembers the beginning.
    "recurrent_ppo-4": Case(
        RecurrentPPO,
        4,
        {"n_steps": 16, "batch_size": 32, "n_epochs": 2},
        network={"lstm_hidden_size": 8, "n_lstm_layers": 2},
    ),
}


class EpisodeRows(BaseCallback):
    """Appends a row per episode, as the training loop of a run does."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._file = path.open("a")

    def _on_step(self) -> bool:
        for info in self.locals["infos"]:
            if "episode" in info:
                self._file.write(f"{self.num_timesteps},{info['episode']['r']!r},{info['episode']['l']}\n")
                self._file.flush()
        return True


class Trained(SB3Learner):
    """A learner around a model that was built by hand."""

    def __init__(self, model: BaseAlgorithm) -> None:
        self.model = model
        self._environment = None


@dataclass
class Session:
    """What carries out a run, without all that has nothing to do with checkpoints."""

    learner: Trained
    checkpointer: Checkpointer
    total_steps: int

    def begin(self) -> int:
        return self.checkpointer.restore(self.learner)

    def step(self, steps: int, transition: Any) -> float:
        check_step(*transition, steps)
        return 0.0

    def checkpoint(self, steps: int) -> None:
        if self.checkpointer.is_due(steps):
            self.checkpointer.save(self.learner, steps)

    def log(self, scalars: Any, steps: int) -> None:
        raise NotImplementedError


def train(
    run: Path,
    case: Case,
    seed: int = 3,
    total: int | None = None,
    watch: Callable[[BaseAlgorithm, Pendulums], None] | None = None,
    callbacks: tuple[BaseCallback, ...] = (),
    **cadence: Any,
) -> tuple[BaseAlgorithm, Pendulums, Checkpointer]:
    """Trains or resumes `run` to its end."""
    (run / "train").mkdir(parents=True, exist_ok=True)
    checkpointer = Checkpointer(run, logs=LOGS, **cadence)
    checkpointer.prepare()
    model, batch = case.build(seed)
    writer = EventWriter(run / "train")
    model.set_logger(Logger(None, [Scalars(writer.write)]))
    checkpointer.parts = {"environment": batch}
    if watch is not None:
        watch(model, batch)
    learner = Trained(model)
    session = Session(learner, checkpointer, total or case.steps)
    follower = Follower(lambda: batch.transition, session)
    everyone = [follower, EpisodeRows(run / "train/episodes.csv"), *callbacks]
    interval = 1 if issubclass(case.algorithm, OnPolicyAlgorithm) else 4
    model.learn(session.total_steps, callback=everyone, log_interval=interval)
    checkpointer.save(learner, model.num_timesteps)
    return model, batch, checkpointer


def fingerprint(model: BaseAlgorithm, batch: Pendulums, run: Path) -> dict[str, str]:
    """A hash per part of everything that a run leaves in memory and on disk."""
    parts = state.capture(model)
    parts.arrays["environment"] = batch.state_dict()
    hashes = {}
    for name, tensors in parts.tensors.items():
        hashes[name] = _hash(tensors)
    for name, arrays in parts.arrays.items():
        for key, array in arrays.items():
            hashes[f"{name}.{key}"] = _hash(array)
    for name, value in parts.values.items():
        hashes[name] = _hash({key: item for key, item in value.items() if key != "elapsed_ns"})
    buffer = getattr(model, "replay_buffer", None)
    if buffer is not None:
        for field in (
            "observations",
            "next_observations",
            "actions",
            "rewards",
            "dones",
            "timeouts",
            "pos",
            "full",
        ):
            hashes[f"replay.{field}"] = _hash(getattr(buffer, field))
    hashes["episodes.csv"] = _hash((run / "train/episodes.csv").read_text())
    hashes["scalars"] = _hash(scalars(run))
    return hashes


def scalars(run: Path) -> dict[str, list[tuple[int, float]]]:
    """TensorBoard's scalars by name as (step, value); rates of the wall clock by step alone."""
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    accumulator = EventAccumulator(str(run / "train"), size_guidance={"scalars": 0})
    accumulator.Reload()
    return {
        tag: [
            (event.step, 0.0 if tag.startswith("time/") else event.value)
            for event in accumulator.Scalars(tag)
        ]
        for tag in accumulator.Tags()["scalars"]
    }


def _hash(value: Any) -> str:
    if isinstance(value, dict):
        text = ";".join(f"{key}={_hash(value[key])}" for key in sorted(value, key=str))
        return hashlib.sha256(text.encode()).hexdigest()
    if isinstance(value, torch.Tensor):
        value = value.detach().numpy()
    if isinstance(value, np.ndarray):
        return hashlib.sha256(f"{value.dtype}{value.shape}".encode() + value.tobytes()).hexdigest()
    return hashlib.sha256(repr(value).encode()).hexdigest()

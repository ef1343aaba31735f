"""Tests on validation scenarios while a run trains: `train/validation.csv`, a row every `train.evaluate_every` steps.

The policy of that moment, deterministic and with frozen statistics, on the scenarios of `conf/protocol/validation.yaml`.
They come from a stream of their own, so that whoever watches, stops or chooses by them has seen no scenario of a test.
Nothing here draws from a generator that training uses: the trained weights are the same bits with and without it.
"""

from __future__ import annotations

import csv
import io
import os
import time
from collections import Counter
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from omegaconf import OmegaConf
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecNormalize

from auvbench.agents.learned import learners
from auvbench.config import schema
from auvbench.evaluation.protocol import circumstances, fingerprint
from auvbench.evaluation.rollout import roll_out
from auvbench.tasks.record import OUTCOMES, Record

COLUMNS = (
    "step",
    "simulated_s",
    "training_episodes",
    "fingerprint",
    "episodes",
    *(f"{outcome}_rate" for outcome in OUTCOMES),
    "mean_steps",
    "mean_duration_s",
    "wall_s",
)
"""docs/runs.md defines them; all but the last are the same bits whenever the run is repeated"""


def protocol() -> schema.Protocol:
    """The installed `conf/protocol/validation.yaml`: a run that goes on elsewhere must meet the same scenarios.

    A file of that name in `./conf` counts for `auvbench evaluate` alone.
    """
    text = (resources.files("auvbench.conf") / "protocol" / "validation.yaml").read_text(encoding="utf-8")
    found = OmegaConf.to_object(
        OmegaConf.merge(OmegaConf.structured(schema.Protocol), OmegaConf.create(yaml.safe_load(text)))
    )
    assert isinstance(found, schema.Protocol)
    return found


class Validator(BaseCallback):
    """Tests the policy that is being trained, and appends a row for each test.

    Args:
        config: the run's resolved configuration, plain.
        every: environment steps between two tests.
        path: of the CSV file.
        keep: bytes of it that stay, where a run goes on; None begins it anew.
        episodes: returns the number of training episodes that have ended so far.
        show: called with the rates by name and the step, for whoever else shows them.

    Attributes:
        spent: s of wall time that the tests took in this process.
    """

    def __init__(
        self,
        config: dict[str, Any],
        every: int,
        path: Path,
        keep: int | None,
        episodes: Callable[[], int],
        show: Callable[[dict[str, float], int], object],
    ) -> None:
        super().__init__()
        self._protocol = protocol()
        conditions = circumstances(self._protocol, config)
        self._config = conditions[0].config
        self._fingerprint = fingerprint(self._protocol, conditions)
        self._frequency = float(config["step"]["frequency"])
        self._normalise = bool(config["train"]["normalise_observations"])
        self._every, self._episodes, self._show = every, episodes, show
        self._tested = -1
        self.spent = 0.0
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = open(path, "ab" if keep else "wb")  # noqa: SIM115
        if keep:
            self._file.truncate(keep)
            self._file.seek(0, os.SEEK_END)
        else:
            self._append(COLUMNS)

    def _on_step(self) -> bool:
        before = self.num_timesteps - self.training_env.num_envs
        if self.num_timesteps // self._every > before // self._every:
            self._test()
        return True

    def _on_training_end(self) -> None:
        # Where the budget is no multiple of the interval; a run that goes on from its last checkpoint comes here too.
        if (
            self.num_timesteps % self._every >= self.training_env.num_envs
            and self._tested != self.num_timesteps
        ):
            self._test()

    def _test(self) -> None:
        began = time.time_ns()
        elapsed = (began - self.model.start_time) / 1e9
        records = self._records()
        counts = Counter(str(record["outcome"]) for record in records)
        rates = {f"{outcome}_rate": counts[outcome] / len(records) for outcome in OUTCOMES}
        row = (
            self.num_timesteps,
            self.num_timesteps / self._frequency,
            self._episodes(),
            self._fingerprint,
            len(records),
            *rates.values(),
            *(
                float(np.mean([float(record[name]) for record in records]))
                for name in ("steps", "duration_s")
            ),
            round(elapsed, 3),
        )
        self._append(row)
        self._show({f"validation/{name}": value for name, value in rates.items()}, self.num_timesteps)
        self._tested = self.num_timesteps
        spent = time.time_ns() - began
        self.spent += spent / 1e9
        self.model.start_time += spent  # steps per second and `wall_s` are those of training alone

    def _records(self) -> list[Record]:
        normaliser, policy = self.model.get_vec_normalize_env(), self.model.policy
        assert isinstance(normaliser, VecNormalize)
        assert normaliser.action_space.shape is not None
        training = policy.training
        policy.set_training_mode(False)
        try:
            agent = learners.FrozenPolicy(
                policy, learners.statistics(normaliser), self._normalise, normaliser.action_space.shape[0]
            )
            numbers = np.arange(self._protocol.episodes)
            return roll_out(
                self._config,
                agent,
                episodes=numbers,
                seed=self._protocol.seed,
                batch=self._protocol.batch,
                scenarios=self._protocol.scenarios,
            ).records
        finally:
            policy.set_training_mode(training)

    def _append(self, row: tuple[object, ...]) -> None:
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerow(row)
        self._file.write(text.getvalue().encode())
        self._file.flush()

    def close(self) -> None:
        """Closes the file."""
        self._file.close()

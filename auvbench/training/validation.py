"""Tests on validation scenarios while a run trains: `train/validation.csv`, a row every `train.evaluate_every` steps.

The policy of that moment, deterministic and with frozen statistics, on the scenarios of `conf/protocol/validation.yaml`.
They come from a stream of their own, so that early stopping and the choice of a policy see no scenario of a test.
Nothing here draws from a generator that training uses: the trained weights are the same bits with and without it.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from auvbench.agents.base import Agent
from auvbench.config.compose import compose
from auvbench.config.validate import evaluate_config
from auvbench.evaluation.protocol import fingerprint, resolve_conditions
from auvbench.evaluation.rollout import roll_out
from auvbench.record import record_columns
from auvbench.registry import TASKS
from auvbench.runs.progress import EpisodeLog


def columns(task: str) -> tuple[str, ...]:
    """Return the columns for a task; docs/runs.md defines them.

    All but the last are the same bits whenever the run is repeated.
    """
    rates = (f"{outcome}_rate" for outcome in TASKS[task].outcomes)
    means = (f"mean_{name}" for name in _means(task))
    return ("step", "simulated_s", "training_episodes", "fingerprint", "episodes", *rates, *means, "wall_s")


def _means(task: str) -> list[str]:
    """Return the columns of a record whose means are written: times, and what the task is ranked by."""
    primary = TASKS[task].primary.removeprefix("mean_")
    return ["steps", "duration_s", *([primary] if primary in record_columns(task) else [])]


class Validator:
    """Tests the policy that is being trained, and appends a row for each test.

    Args:
        config: the run's resolved configuration, plain.
        every: environment steps between two tests.
        path: of the CSV file.
        keep: bytes of it that stay, where a run goes on; None begins it anew.
        show: called with the rates by name and the step, for other displays.

    Attributes:
        spent: s of wall time that the tests took in this process.
    """

    def __init__(
        self,
        config: dict[str, Any],
        every: int,
        path: Path,
        keep: int | None,
        show: Callable[[dict[str, float], int], object],
    ) -> None:
        # The installed file, not one in ./conf: a run that goes on elsewhere must meet the same scenarios.
        self._protocol = evaluate_config(compose("evaluate", ["protocol=validation"], folder=None)).protocol
        conditions = resolve_conditions(self._protocol, config)
        self._config = conditions[0].config
        self._fingerprint = fingerprint(self._protocol, conditions)
        self._frequency = float(config["step"]["frequency"])
        self._every, self._show = every, show
        self._tested = -1
        self.spent = 0.0
        self._columns = columns(self._config.task.name)[1:]
        self._log = EpisodeLog(self._columns, path, keep or None)
        self._log.flush()

    def is_due(self, steps: int, n: int) -> bool:
        """Whether the last step of n environments, with which `steps` lie behind, passed a multiple of the interval."""
        return steps // self._every > (steps - n) // self._every

    def is_owed(self, steps: int, n: int) -> bool:
        """Whether the end of a training is still to be tested.

        That is where the budget is no multiple of the interval; a run that goes on from its last checkpoint comes
        here too.
        """
        return steps % self._every >= n and self._tested != steps

    def test(self, agent: Agent, steps: int, episodes: int, elapsed: float) -> float:
        """Tests a policy and writes a row; returns the s that this took.

        Args:
            agent: acts as the policy does now.
            steps: environment steps that lie behind.
            episodes: training episodes that have ended.
            elapsed: s of wall time of training so far, without tests.
        """
        began = time.monotonic()
        records = roll_out(
            self._config,
            agent,
            episodes=np.arange(self._protocol.episodes),
            seed=self._protocol.seed,
            batch=self._protocol.batch,
            scenarios=self._protocol.scenarios,
        ).records
        counts = Counter(str(record["outcome"]) for record in records)
        task = self._config.task.name
        rates = {f"{outcome}_rate": counts[outcome] / len(records) for outcome in TASKS[task].outcomes}
        means = (float(np.mean([float(record[name]) for record in records])) for name in _means(task))
        row: tuple[float | int | str, ...] = (
            steps / self._frequency,
            episodes,
            self._fingerprint,
            len(records),
            *rates.values(),
            *means,
            round(elapsed, 3),
        )
        self._log.append(steps, [dict(zip(self._columns, row, strict=True))])
        self._log.flush()
        self._show({f"validation/{name}": value for name, value in rates.items()}, steps)
        self._tested = steps
        spent = time.monotonic() - began
        self.spent += spent
        return spent

    def close(self) -> None:
        """Closes the file."""
        self._log.close()

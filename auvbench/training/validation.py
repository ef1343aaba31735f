"""Test a run on validation scenarios during training: `train/validation.csv`, one row every
`train.evaluate_every` steps.

Each test applies the present policy, deterministic and with frozen normalisation statistics, to the scenarios of
`conf/protocol/validation.yaml`. These scenarios have their own stream of random numbers, so that early stopping and the
choice of a policy use no test scenario. The tests draw from no generator that training uses: the trained weights
are bit-identical with and without these tests.
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
    """Return the columns of `train/validation.csv` for a task; docs/runs.md defines them.

    If the run is repeated, all columns but the last (wall time) are bit-identical.
    """
    rates = (f"{outcome}_rate" for outcome in TASKS[task].outcomes)
    means = (f"mean_{name}" for name in _means(task))
    return ("step", "simulated_s", "training_episodes", "fingerprint", "episodes", *rates, *means, "wall_s")


def _means(task: str) -> list[str]:
    """Return the columns of an episode's record whose means a test writes: steps, duration, and the task's primary measure if recorded."""
    primary = TASKS[task].primary.removeprefix("mean_")
    return ["steps", "duration_s", *([primary] if primary in record_columns(task) else [])]


class Validator:
    """Tests the policy during training, and appends a row for each test.

    Args:
        config: resolved, plain configuration of the run.
        every: environment steps between two tests.
        path: path of the CSV file.
        keep: number of bytes of the file to keep when a run continues; None starts a new file.
        show: function called after each test with the rates by name and the step, for example to log them.

    Attributes:
        spent: wall time in s of the tests in this process.
    """

    def __init__(
        self,
        config: dict[str, Any],
        every: int,
        path: Path,
        keep: int | None,
        show: Callable[[dict[str, float], int], object],
    ) -> None:
        # The installed file, not a file in ./conf: a run that continues elsewhere must meet the same scenarios.
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
        """Return whether a test is due: the last step of n environments passed a multiple of the interval.

        Args:
            steps: environment steps after this step.
            n: number of environments, each of which has added one step.
        """
        return steps // self._every > (steps - n) // self._every

    def is_owed(self, steps: int, n: int) -> bool:
        """Return whether the final policy of a training must still be tested, after `steps` steps of n environments.

        The final test is owed unless the last step passed a multiple of the interval, or this process has already tested the
        policy at this step.
        """
        return steps % self._every >= n and self._tested != steps

    def test(self, agent: Agent, steps: int, episodes: int, elapsed: float) -> float:
        """Test a policy and write a row; return the duration in s.

        Args:
            agent: agent that acts by the present policy.
            steps: finished environment steps.
            episodes: number of ended training episodes.
            elapsed: wall time in s of training so far, without tests.
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
        """Close the file."""
        self._log.close()

"""What a learner calls while it trains (`auvbench.agents.base.Callbacks`): records, progress, tests, checkpoints, stopping."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.agents.base import Environment, Learner, Transition
from auvbench.errors import TrainingError
from auvbench.runs import lock
from auvbench.runs.directory import RunDirectory
from auvbench.runs.interruption import Interrupted, Request
from auvbench.runs.progress import EpisodeLog, Reporter
from auvbench.training.checkpoint.logs import EventWriter
from auvbench.training.checkpoint.saver import Checkpointer
from auvbench.training.validation import Validator

GRACE = 20.0  # s to reach the next checkpoint after SIGTERM; SLURM kills 30 s after it by default


class Session:
    """One training, as its learner sees it.

    Args:
        run: its directory.
        learner: who learns; the one that is saved and tested.
        environment: in which it learns.
        total_steps: the budget, in environment steps.
        checkpointer: prepared, with its parts.
        log: of the episodes.
        events: of the scalars.
        reporter: of the progress.
        validator: tests the policy on the way; None where it is not wanted.
        stop: checked in every step: whether the run shall stop.

    Attributes:
        steps: environment steps that lie behind.
        began_at: when training began, by the monotonic clock; None before `begin`.
    """

    def __init__(
        self,
        run: RunDirectory,
        learner: Learner,
        environment: Environment,
        total_steps: int,
        *,
        checkpointer: Checkpointer,
        log: EpisodeLog,
        events: EventWriter,
        reporter: Reporter,
        validator: Validator | None,
        stop: Request,
    ) -> None:
        self.total_steps = total_steps
        self.steps = 0
        self.began_at: float | None = None
        self._run, self._learner, self._environment = run, learner, environment
        self._checkpointer, self._log, self._events = checkpointer, log, events
        self._reporter, self._validator, self._stop = reporter, validator, stop
        self._asked_at: float | None = None

    def begin(self) -> int:
        """As the contract says."""
        self.began_at = time.monotonic()
        self.steps = self._checkpointer.restore(self._learner)
        return self.steps

    def step(self, steps: int, transition: Transition) -> float:
        """As the contract says.

        Raises:
            TrainingError: an observation or a reward is not finite.
            Interrupted: the run was asked to stop, and no checkpoint can be waited for.
        """
        self.steps = steps
        check_step(transition.observation, transition.reward, steps)
        if self._stop.signal is not None:
            self._asked_at = self._asked_at or time.monotonic()
            if not self._learner.exact_resume or time.monotonic() - self._asked_at > GRACE:
                self._leave(self._kept())
        if transition.records:
            self._log.append(steps, transition.records)
            for record in transition.records:
                self._reporter.episode(record["outcome"] == "success", float(record["return"]))
        self._reporter.step(steps)
        if self._validator is not None and self._validator.is_due(steps, self._environment.n):
            return self._test(self._validator)
        return 0.0

    def _test(self, validator: Validator) -> float:
        elapsed = self._checkpointer.elapsed
        spent = validator.test(self._learner, self.steps, self._reporter.episodes, elapsed)
        self._checkpointer.paused += spent
        return spent

    def checkpoint(self, steps: int) -> None:
        """As the contract says.

        Raises:
            Interrupted: the run was asked to stop; it is saved.
        """
        self.steps = steps
        lock.verify(self._run.path, every=1.0)
        if self._stop.signal is not None:
            if self._learner.exact_resume:
                self._checkpointer.save(self._learner, steps)
                self._leave(f"saved at step {steps:,}")
            self._leave(self._kept())
        if self._learner.exact_resume and self._checkpointer.is_due(steps):
            self._checkpointer.save(self._learner, steps)

    def log(self, scalars: Mapping[str, float], steps: int) -> None:
        """As the contract says."""
        self._events.write(scalars, steps)

    def end(self) -> None:
        """Call when the learner has returned: saves the last checkpoint, and tests once more where that is owed.

        Raises:
            TrainingError: the budget is not used up.
        """
        if self.steps < self.total_steps:
            raise TrainingError(
                f"the learner returned at step {self.steps:,} of {self.total_steps:,}; it must go on until the budget is used up"
            )
        lock.verify(self._run.path)
        if self._learner.exact_resume:
            self._checkpointer.save(self._learner, self.steps)
        if self._validator is not None and self._validator.is_owed(self.steps, self._environment.n):
            self._test(self._validator)

    def _kept(self) -> str:
        if self._learner.exact_resume:
            return f"the last checkpoint is of step {self._checkpointer.saved_step:,}"
        return "which this learner cannot go on from: it begins anew"

    def _leave(self, what: str) -> None:
        assert self._stop.signal is not None
        cause = {"SIGINT": "Ctrl-C", "SIGTERM": "SIGTERM"}.get(self._stop.signal.name, self._stop.signal.name)
        goes_on = "; the same command goes on from there" if self._learner.exact_resume else ""
        raise Interrupted(self._stop.signal, f"{self._run.path}: stopped by {cause}, {what}{goes_on}")


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

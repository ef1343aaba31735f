"""The callback that resumes a run at its start, saves it on its way and stops it when asked or when it is ill."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm

from auvbench.errors import TrainingError
from auvbench.runs import lock
from auvbench.runs.durable import storage
from auvbench.runs.interruption import Interrupted, Request
from auvbench.training.checkpoint import finite, state
from auvbench.training.checkpoint.logs import GrowingLog, LogMark, cut
from auvbench.training.checkpoint.replay import ReplayStore, rows_added
from auvbench.training.checkpoint.state import Stateful, Subject
from auvbench.training.checkpoint.store import Checkpoint, CheckpointStore

GRACE = 20.0  # s to reach the end of a rollout after SIGTERM; SLURM kills 30 s after it by default


class Checkpointer(BaseCallback):
    """Saves a run so that it continues with the same bits.

    Use it in this order, and first in a list of callbacks, so that those after it see the restored counters:

        checkpointer = Checkpointer(run, logs=[...])
        checkpointer.prepare()              # before anything opens the logs
        ... build environments, learner, writers of the logs ...
        checkpointer.parts = {"environment": batch}
        model.learn(total_steps, callback=[checkpointer, ...], reset_num_timesteps=True)

    `learn` is called the same way for a new and for a resumed run: when training starts, the checkpoint
    replaces everything that building and `learn` have set up.

    Args:
        run: the run's directory.
        every_steps: save after this many environment steps, 0 for never.
        every_seconds: save after this much wall time, 0 for never.
        keep: complete checkpoints that stay.
        logs: files that only grow, relative to `run`; cut back on resume.
        stop: looked at in every step: whether somebody wants the run to stop.

    Attributes:
        parts: carriers of state beside the learner, by name.
        flush: called before the logs are measured; hands over what their writers still hold back.
        saved_hook: called after each checkpoint, for those who note elsewhere how far the run is.
        resumed: the checkpoint that the run goes on from; None for a new run.
        saved: checkpoints written by this process.
        spent: s of wall time that writing them took.
    """

    def __init__(
        self,
        run: Path,
        every_steps: int = 0,
        every_seconds: float = 0.0,
        keep: int = 2,
        logs: Sequence[str] = (),
        stop: Request | None = None,
    ) -> None:
        super().__init__()
        self.store = CheckpointStore(run, keep)
        self.parts: Mapping[str, Stateful] = {}
        self.flush: Callable[[], object] = _nothing
        self.saved_hook: Callable[[], object] = _nothing
        self.resumed: Checkpoint | None = None
        self.spent = 0.0
        self.saved = 0
        self._every_steps, self._every_seconds = every_steps, every_seconds
        self._logs = {name: GrowingLog(run / name) for name in logs}
        self._replay = ReplayStore(self.store.replay_folder)
        self._stop = stop or Request()
        self._asked_at: float | None = None
        self._saved_step = -1
        self._saved_at = 0.0
        self._draws_to_restore: Checkpoint | None = None

    def prepare(self) -> Checkpoint | None:
        """Finds the newest whole checkpoint and cuts the logs back to it; returns it, None for a new run.

        Raises:
            RunError, TrainingError: see `CheckpointStore.latest_valid`.
        """
        self.resumed = self.store.latest_valid()
        marks: Mapping[str, LogMark] = self.resumed.logs if self.resumed else {}
        with storage(f"cannot resume {self.store.run}"):
            for name, log in self._logs.items():
                cut(log.path, marks[name].length if name in marks else 0)
        return self.resumed

    @property
    def subject(self) -> Subject:
        return Subject(self.model, self.parts)

    def _on_training_start(self) -> None:
        self._saved_at = time.monotonic()
        self._saved_step = 0
        if self.resumed is None:
            return
        state.restore(self.subject, self.resumed.components)
        self.num_timesteps = self._saved_step = self.model.num_timesteps
        buffer = self.subject.replay_buffer
        if buffer is not None:
            rows = self.model.num_timesteps // buffer.n_envs
            self._replay.load(buffer, self.resumed.segments, rows)
        if self.resumed.components.values["learner"]["at_rollout_start"]:
            self._draws_to_restore = self.resumed

    def _on_rollout_start(self) -> None:
        if self._draws_to_restore is not None:
            # gSDE draws exploration matrices between the start of training and here; the checkpoint was
            # taken here, after that draw.
            state.restore_draws(self.subject, self._draws_to_restore.components)
            self._draws_to_restore = None
        lock.verify(self.store.run, look=False)
        finite.check_losses(self.model)
        if isinstance(self.model, OnPolicyAlgorithm):
            # A rollout of many steps follows, so looking at every weight costs nothing beside it.
            finite.check_parameters(self.model)
        if self._stop.signal is not None:
            self.save()
            self._leave(f"saved at step {self.model.num_timesteps:,}")
        if self._is_due():
            self.save()

    def _on_step(self) -> bool:
        finite.check_step(
            self.locals["new_obs"], self.locals["rewards"], self.subject.normalize, self.num_timesteps
        )
        if self._stop.signal is not None:
            self._asked_at = self._asked_at or time.monotonic()
            if time.monotonic() - self._asked_at > GRACE:
                self._leave(f"the last checkpoint is of step {self._saved_step:,}")
        return True

    def _on_training_end(self) -> None:
        # A callback that returned False ended training in the middle of a step: nothing to save there.
        if self.model.num_timesteps >= self.model._total_timesteps:
            finite.check_losses(self.model)
            self.save(at_rollout_start=False)

    def save(self, at_rollout_start: bool = True) -> None:
        """Writes a checkpoint of this very moment, unless there is one of this step already.

        Raises:
            TrainingError: the weights are not finite, or the disk does not take it.
        """
        step = self.model.num_timesteps
        if step == self._saved_step:
            return
        began = time.monotonic()
        lock.verify(self.store.run)
        finite.check_parameters(self.model)
        components = state.capture(self.subject)
        components.values["learner"]["at_rollout_start"] = at_rollout_start
        buffer = self.subject.replay_buffer
        try:
            with storage(f"cannot write the checkpoint of step {step}"):
                self.flush()
                marks = {name: log.mark() for name, log in self._logs.items()}
                segments = [] if buffer is None else self._replay.save(buffer, rows_added(buffer, step))
            self.store.save(step, components, tuple(segments), marks)
        except TrainingError:
            self.store.prune()  # segments that no checkpoint names only fill the disk further
            raise
        with storage(f"cannot note the checkpoint of step {step}"):
            self.saved_hook()
        self._saved_step, self._saved_at = step, time.monotonic()
        self.spent += self._saved_at - began
        self.saved += 1

    def _is_due(self) -> bool:
        steps = self.model.num_timesteps - self._saved_step
        # The monotonic clock: the wall clock may jump, also backwards.
        return 0 < self._every_steps <= steps or (
            0 < self._every_seconds <= time.monotonic() - self._saved_at and steps > 0
        )

    def _leave(self, what: str) -> None:
        assert self._stop.signal is not None
        cause = {"SIGINT": "Ctrl-C", "SIGTERM": "SIGTERM"}.get(self._stop.signal.name, self._stop.signal.name)
        raise Interrupted(
            self._stop.signal,
            f"{self.store.run}: stopped by {cause}, {what}; the same command goes on from there",
        )


def _nothing() -> None:
    """For those who have nothing to do there."""

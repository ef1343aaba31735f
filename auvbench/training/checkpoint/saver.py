"""Saves a run on its way, and brings it back to where it was saved."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from auvbench.agents.base import Learner, replay
from auvbench.errors import TrainingError
from auvbench.runs import lock
from auvbench.runs.atomic_io import storage
from auvbench.training.checkpoint.logs import GrowingLog, LogMark, cut
from auvbench.training.checkpoint.replay import ReplayStore
from auvbench.training.checkpoint.store import Checkpoint, CheckpointStore

CLOCK = "clock"
"""The component that holds for how long the run has trained."""


class Stateful(Protocol):
    """Anything beside the learner that a run carries from step to step: the environments, a recorder."""

    def state_dict(self) -> Mapping[str, NDArray[Any]]: ...

    def load_state_dict(self, state: Mapping[str, NDArray[Any]], /) -> None: ...


class Checkpointer:
    """Saves a run so that it continues with the same bits.

    Use it in this order:

        checkpointer = Checkpointer(run, logs=[...])
        checkpointer.prepare()              # before anything opens the logs
        ... build environments, learner, writers of the logs ...
        checkpointer.parts = {"environment": batch}
        checkpointer.restore(learner)       # when the learner is about to begin
        checkpointer.save(learner, steps)   # wherever its state is whole

    Args:
        run: the run's directory.
        every_steps: save after this many environment steps, 0 for never.
        every_seconds: save after this much wall time, 0 for never.
        keep: complete checkpoints that stay.
        logs: files that only grow, relative to `run`; cut back on resume.

    Attributes:
        parts: carriers of state beside the learner, by name.
        flush: called before the logs are measured; hands over what their writers still hold back.
        saved_hook: called after each checkpoint, for those who note elsewhere how far the run is.
        resumed: the checkpoint that the run goes on from; None for a new run.
        saved: checkpoints written by this process.
        saved_step: environment steps of the newest checkpoint, 0 before the first.
        spent: s of wall time that writing them took.
        paused: s of wall time since `restore` that are to count as none of training.
    """

    def __init__(
        self,
        run: Path,
        every_steps: int = 0,
        every_seconds: float = 0.0,
        keep: int = 2,
        logs: Sequence[str] = (),
    ) -> None:
        self.store = CheckpointStore(run, keep)
        self.parts: Mapping[str, Stateful] = {}
        self.flush: Callable[[], object] = _nothing
        self.saved_hook: Callable[[], object] = _nothing
        self.resumed: Checkpoint | None = None
        self.spent = 0.0
        self.paused = 0.0
        self.saved = 0
        self.saved_step = 0
        self._every_steps, self._every_seconds = every_steps, every_seconds
        self._logs = {name: GrowingLog(run / name) for name in logs}
        self._replay = ReplayStore(self.store.replay_folder)
        self._saved_at = 0.0
        self._began, self._earlier = time.monotonic(), 0.0

    def prepare(self) -> Checkpoint | None:
        """Finds the newest whole checkpoint and cuts the logs back to it; returns it, None for a new run.

        Raises:
            RunError, TrainingError: see `CheckpointStore.latest_valid`.
        """
        self.resumed = self.store.latest_valid()
        marks: Mapping[str, LogMark] = self.resumed.logs if self.resumed else {}
        with storage(f"cannot resume {self.store.run}"):
            for name, log in self._logs.items():
                cut(log.path, marks[name].bytes if name in marks else 0)
        return self.resumed

    def restore(self, learner: Learner) -> int:
        """Brings the parts and the learner back to the checkpoint; returns its step, 0 for a new run.

        Raises:
            RunError: the checkpoint is of another learner.
        """
        self._saved_at = self._began = time.monotonic()
        if self.resumed is None:
            return 0
        components, step = self.resumed.components, self.resumed.step
        for name, part in self.parts.items():
            part.load_state_dict(components.arrays[f"part-{name}"])
        learner.restore(components)  # last: it brings back generators, from which the others might draw
        ring = replay(learner)
        if ring is not None:
            self._replay.load(ring, self.resumed.segments, step // ring.n_envs)
        self.saved_step = step
        # Checkpoints that are older than the clock's own file have the time in what SB3's learners keep.
        clock = components.values.get(CLOCK) or components.values.get("learner", {})
        self._earlier = clock.get("elapsed_ns", 0) / 1e9
        return step

    @property
    def elapsed(self) -> float:
        """S of wall time that the run has trained, those before a resume included."""
        return self._earlier + time.monotonic() - self._began - self.paused

    def save(self, learner: Learner, step: int) -> None:
        """Writes a checkpoint of this very moment, unless there is one of this step already.

        Raises:
            TrainingError: the learner is not fit to be saved, or the disk does not take it.
        """
        if step == self.saved_step:
            return
        began = time.monotonic()
        lock.verify(self.store.run)
        components = learner.state()
        for name, part in self.parts.items():
            components.arrays[f"part-{name}"] = {
                key: np.asarray(value) for key, value in part.state_dict().items()
            }
        components.values[CLOCK] = {"elapsed_ns": round(self.elapsed * 1e9)}
        ring = replay(learner)
        try:
            with storage(f"cannot write the checkpoint of step {step}"):
                self.flush()
                marks = {name: log.mark() for name, log in self._logs.items()}
                segments = [] if ring is None else self._replay.save(ring, step // ring.n_envs)
            self.store.save(step, components, tuple(segments), marks)
        except TrainingError:
            self.store.prune()  # segments that no checkpoint names only fill the disk further
            raise
        with storage(f"cannot note the checkpoint of step {step}"):
            self.saved_hook()
        self.saved_step, self._saved_at = step, time.monotonic()
        self.spent += self._saved_at - began
        self.saved += 1

    def is_due(self, step: int) -> bool:
        """Whether so many steps, or so much time, have passed since the last one."""
        steps = step - self.saved_step
        # The monotonic clock: the wall clock may jump, also backwards.
        return 0 < self._every_steps <= steps or (
            0 < self._every_seconds <= time.monotonic() - self._saved_at and steps > 0
        )


def _nothing() -> None:
    """For those who have nothing to do there."""

"""Where a run stands: what its manifest says, corrected by whether somebody still works on it.

A process that is killed cannot write that into its manifest, so `running` is believed only while the run's
lock has a living holder.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

from auvbench.runs import lock, lock_files
from auvbench.runs.directory import RunDirectory


class State(StrEnum):
    """The states of a run, in the order of its life."""

    PENDING = "pending"
    RUNNING = "running"
    INTERRUPTED = "interrupted"
    FAILED = "failed"
    COMPLETE = "complete"


@dataclass(frozen=True, slots=True)
class Standing:
    """A run as it is now."""

    run: RunDirectory
    state: State
    manifest: dict[str, Any]
    holder: lock_files.Holder | None = None  # who works on it, while it is running

    @property
    def name(self) -> str:
        return self.run.path.name


def of(run: RunDirectory, *, clock: Callable[[Path], float] | None = None) -> Standing:
    """Looks at a run once.

    Args:
        run: the run directory.
        clock: as in `lock.living_holder`, for looking at many.
    """
    manifest = run.manifest()
    state = State(manifest["state"])
    if state is State.COMPLETE:
        return Standing(run, state, manifest)
    holder = lock.living_holder(run.path, clock=clock)
    if holder is not None:
        return Standing(run, State.RUNNING, manifest, holder)
    if state is State.RUNNING:
        state = State.INTERRUPTED
    return Standing(run, state, manifest)

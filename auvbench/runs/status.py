"""Compute the status of a run: the state in its manifest, corrected by whether a process still works on it.

A killed process cannot record its end in the manifest. The state `running` is therefore valid only while a process holds
the run's lock.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from auvbench.runs import integrity, lock
from auvbench.runs.directory import RunDirectory


class State(StrEnum):
    """State of a run; the values are in the order in which a run reaches them."""

    PENDING = "pending"
    RUNNING = "running"
    INTERRUPTED = "interrupted"
    FAILED = "failed"
    COMPLETE = "complete"


@dataclass(frozen=True, slots=True)
class RunStatus:
    """A run, its state and its manifest."""

    run: RunDirectory
    state: State
    manifest: dict[str, Any]
    holder: lock.Holder | None = None
    """process that works on the run"""
    lost: str = ""
    """missing or damaged model file of a run whose manifest says complete; '' if the model is intact"""


def of(run: RunDirectory, manifest: dict[str, Any] | None = None, *, deep: bool = False) -> RunStatus:
    """Return the present status of a run.

    Args:
        run: the run directory.
        manifest: the run's manifest, if it was read already.
        deep: compare the digests of a complete run's model files, not only their sizes.
    """
    manifest = run.manifest() if manifest is None else manifest
    state = State(manifest["state"])
    lost = lost_model(run, manifest, deep=deep) if state is State.COMPLETE else ""
    if state is State.COMPLETE and not lost:
        return RunStatus(run, state, manifest)
    holder = lock.living_holder(run.path)
    if holder is not None:
        return RunStatus(run, State.RUNNING, manifest, holder, lost)
    if lost or state is State.RUNNING:
        state = State.INTERRUPTED
    return RunStatus(run, state, manifest, lost=lost)


def finished(run: RunDirectory, manifest: dict[str, Any] | None = None) -> bool:
    """Return whether a run is complete and its model is unchanged."""
    manifest = run.manifest() if manifest is None else manifest
    return manifest["state"] == "complete" and not lost_model(run, manifest)


def lost_model(run: RunDirectory, manifest: dict[str, Any], *, deep: bool = True) -> str:
    """Return the missing or damaged file of a complete run's model; '' if the model is intact."""
    return integrity.lacking(run.path, manifest, f"{run.model.name}/", deep=deep)

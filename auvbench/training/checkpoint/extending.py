"""Extend a run to a larger budget from its last checkpoint. The result is bit-identical to one longer run."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf

from auvbench.agents.base import learner_of
from auvbench.config.algorithms import learns
from auvbench.config.compose import typed
from auvbench.config.schema import TrainConfig
from auvbench.errors import ConfigError, RunError
from auvbench.runs import status
from auvbench.runs.atomic_io import replace_folder, storage, write_atomic
from auvbench.runs.directory import RunDirectory, freeze, place
from auvbench.training.checkpoint.store import Checkpoint, CheckpointStore
from auvbench.untrusted import path_safety
from auvbench.untrusted.path_safety import child
from auvbench.vehicles import sheet


def seed(source: Path, checkpoint: Checkpoint, target: Path) -> None:
    """Copy a checkpoint, its replay segments and the logs up to the checkpoint into another run's directory.

    The checkpoint itself is moved into place last and atomically. A kill before this move leaves `target` without
    a checkpoint, and the next call copies everything again. Nothing changes in `source`.

    Args:
        source: directory of the run that has the checkpoint.
        checkpoint: verified checkpoint from `CheckpointStore.peek`.
        target: directory of the extended run; it has no checkpoint yet.

    Raises:
        TrainingError: the disk is full, read-only or failing.
        RunError: `target` contains a link.
    """
    path_safety.refuse_links(target)
    source_store, target_store = CheckpointStore(source), CheckpointStore(target)
    with storage(f"cannot copy the checkpoint of step {checkpoint.step} to {target}"):
        for name, mark in checkpoint.logs.items():
            write_atomic(child(target, name), child(source, name).read_bytes()[: mark.bytes])
        for segment in checkpoint.segments:
            data = (source_store.replay_folder / segment.name).read_bytes()
            write_atomic(target_store.replay_folder / segment.name, data)
        files = {path.name: path.read_bytes() for path in checkpoint.path.iterdir()}
        replace_folder(target_store.folder / str(checkpoint.step), files)


@dataclass(frozen=True, slots=True)
class Extension:
    """Extension of the run `run`: `target` has the same configuration with a larger budget. `run` does not change."""

    run: RunDirectory
    config: dict[str, Any]
    target: RunDirectory
    checkpoint: Checkpoint | None
    """checkpoint from which `target` begins; None if `target` has begun already"""

    def begin(self, command: str = "") -> RunDirectory:
        """Create the extended run from the checkpoint, unless the extended run has already begun; return the extended run.

        Args:
            command: command line, for the manifest.
        """
        if self.checkpoint is not None:
            freeze(self.config, command)
            seed(self.run.path, self.checkpoint, self.target.path)
            self.target.update_manifest(steps=self.checkpoint.step)
        return self.target


def prepare(run: RunDirectory, total_steps: int) -> Extension:
    """Check that a run can be extended, and return the extension; write nothing.

    Args:
        run: trained run with at least one checkpoint.
        total_steps: new budget in environment steps.

    Raises:
        ConfigError: the budget is not larger.
        RunError: the run cannot be extended; the message says why.
    """
    config = run.check()
    config_typed = typed(OmegaConf.create(config))
    if total_steps <= config_typed.train.total_steps:
        raise ConfigError(
            f"train.total_steps={total_steps}: must be more than the {config_typed.train.total_steps} of {run.path}"
        )
    _check_schedule(run, config, config_typed)
    run_status = status.of(run)
    if run_status.holder is not None:
        raise RunError(f"{run.path} is locked by {run_status.holder}; extend it when it has ended")
    larger = copy.deepcopy(config)
    larger["train"]["total_steps"] = total_steps
    # Place the extended run next to the run, whose folder may have been moved. Neither `output` nor `name` is part of a run's identity.
    larger["output"], larger["name"] = str(run.path.parent.parent), run.path.parent.name
    typed(OmegaConf.create(larger))
    target = place(larger)
    if has_begun(target):
        return Extension(run, larger, target, None)
    checkpoint = CheckpointStore(run.path).peek()
    if checkpoint is None:
        raise RunError(f"{run.path}: has no checkpoint to extend; train it with auvbench resume {run.path}")
    return Extension(run, larger, target, checkpoint)


def has_begun(run: RunDirectory) -> bool:
    """Return whether an extended run is complete or has its own checkpoint, so that it needs no checkpoint of the shorter run."""
    return run.exists() and (run.manifest()["state"] == "complete" or bool(CheckpointStore(run.path).steps()))


def _check_schedule(run: RunDirectory, config: dict[str, Any], typed: TrainConfig) -> None:
    algo = config["algo"]
    if not learns(algo):
        raise RunError(f"{run.path}: {algo['name']} does not learn, so there is nothing to extend")
    # All of auvbench's own learners resume exactly.
    if algo.get("package") and not learner_of(typed, sheet.load(typed.vehicle)).exact_resume:
        raise RunError(
            f"{run.path} cannot be extended: {algo['name']} does not resume exactly; train a new run"
        )
    if algo.get("learning_rate_schedule", "constant") != "constant":
        raise RunError(
            f"{run.path} cannot be extended: with algo.learning_rate_schedule={algo['learning_rate_schedule']} the "
            "learning rate at every step depends on train.total_steps, so a longer run differs from its "
            "first step on; train it with auvbench train"
        )

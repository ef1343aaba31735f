"""A run with a larger budget that begins where a smaller one ended, with the same bits as one run."""

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
    """Copy a checkpoint, its replay segments and the logs up to it into another run's directory.

    The checkpoint itself arrives last and whole, so a kill leaves a run without a checkpoint, which the next call
    seeds again. Nothing changes in `source`.

    Args:
        source: directory of the run that made the checkpoint.
        checkpoint: verified, from `CheckpointStore.peek`.
        target: directory of the run that goes on from there; it has no checkpoint yet.

    Raises:
        TrainingError: the disk is full, read-only or failing.
        RunError: a link lies in `target`.
    """
    path_safety.refuse_links(target)
    there, here = CheckpointStore(source), CheckpointStore(target)
    with storage(f"cannot copy the checkpoint of step {checkpoint.step} to {target}"):
        for name, mark in checkpoint.logs.items():
            write_atomic(child(target, name), child(source, name).read_bytes()[: mark.bytes])
        for segment in checkpoint.segments:
            data = (there.replay_folder / segment.name).read_bytes()
            write_atomic(here.replay_folder / segment.name, data)
        files = {path.name: path.read_bytes() for path in checkpoint.path.iterdir()}
        replace_folder(here.folder / str(checkpoint.step), files)


@dataclass(frozen=True, slots=True)
class Extension:
    """A run of the same configuration with a larger budget; the run that it extends stays as it is."""

    run: RunDirectory
    config: dict[str, Any]
    target: RunDirectory
    checkpoint: Checkpoint | None
    """where `target` begins; None if it has begun already"""

    def begin(self, command: str = "") -> RunDirectory:
        """Make the directory with the newest checkpoint; `command` is the command line for the manifest."""
        if self.checkpoint is not None:
            freeze(self.config, command)
            seed(self.run.path, self.checkpoint, self.target.path)
            self.target.update_manifest(steps=self.checkpoint.step)
        return self.target


def prepare(run: RunDirectory, total_steps: int) -> Extension:
    """Check whether a run can be extended; write nothing.

    Args:
        run: a run that was trained, at least as far as its first checkpoint.
        total_steps: the new budget in environment steps.

    Raises:
        ConfigError: the budget is not larger.
        RunError: the run cannot be extended; the message says why.
    """
    config = run.check()
    made = typed(OmegaConf.create(config))
    if total_steps <= made.train.total_steps:
        raise ConfigError(
            f"train.total_steps={total_steps}: must be more than the {made.train.total_steps} of {run.path}"
        )
    _check_schedule(run, config, made)
    now = status.of(run)
    if now.holder is not None:
        raise RunError(f"{run.path} is held by {now.holder}; extend it when it has ended")
    larger = copy.deepcopy(config)
    larger["train"]["total_steps"] = total_steps
    # In the run's folder, which may have been moved; neither key is part of the identity.
    larger["output"], larger["name"] = str(run.path.parent.parent), run.path.parent.name
    typed(OmegaConf.create(larger))
    target = place(larger)
    if has_begun(target):
        return Extension(run, larger, target, None)
    checkpoint = CheckpointStore(run.path).peek()
    if checkpoint is None:
        raise RunError(
            f"{run.path}: there is no checkpoint to go on from; auvbench resume {run.path} trains it"
        )
    return Extension(run, larger, target, checkpoint)


def has_begun(run: RunDirectory) -> bool:
    """Return whether a run needs no checkpoint of another one."""
    return run.exists() and (run.manifest()["state"] == "complete" or bool(CheckpointStore(run.path).steps()))


def _check_schedule(run: RunDirectory, config: dict[str, Any], made: TrainConfig) -> None:
    algo = config["algo"]
    if not learns(algo):
        raise RunError(f"{run.path}: {algo['name']} does not learn, so there is nothing to extend")
    # Of auvbench's own learners all resume exactly.
    if algo.get("package") and not learner_of(made, sheet.load(made.vehicle)).exact_resume:
        raise RunError(
            f"{run.path} cannot be extended: {algo['name']} does not resume exactly; train it anew"
        )
    if algo.get("learning_rate_schedule", "constant") != "constant":
        raise RunError(
            f"{run.path} cannot be extended: with algo.learning_rate_schedule={algo['learning_rate_schedule']} the "
            "learning rate at every step depends on train.total_steps, so a longer run is another run from its "
            "first step on; train it with auvbench train"
        )

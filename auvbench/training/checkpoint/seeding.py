"""Starting one run from another's checkpoint: the same run with a larger budget."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from auvbench.runs.atomic_io import fsync_directory, make_folder, storage, write_durable
from auvbench.training.checkpoint.store import Checkpoint, CheckpointStore
from auvbench.untrusted import path_safety


def seed(source: Path, checkpoint: Checkpoint, target: Path) -> None:
    """Copies a checkpoint, the replay segments it names and the logs up to it into another run's directory.

    The checkpoint itself arrives last and whole, so a kill in between leaves a run without a checkpoint, which
    the next call seeds again. Nothing changes in `source`.

    Args:
        source: directory of the run that the checkpoint is of.
        checkpoint: verified, from `CheckpointStore.peek`.
        target: directory of the run that is to go on from there; it has no checkpoint yet.

    Raises:
        TrainingError: the disk is full, read-only or failing.
    """
    path_safety.check(target)
    there, here = CheckpointStore(source), CheckpointStore(target)
    staging = here.folder / f".staging-seed-{os.getpid()}"
    with storage(f"cannot copy the checkpoint of step {checkpoint.step} to {target}"):
        try:
            for name, mark in checkpoint.logs.items():
                make_folder((target / name).parent)
                write_durable(target / name, (source / name).read_bytes()[: mark.length])
                fsync_directory((target / name).parent)
            make_folder(here.replay_folder)
            for segment in checkpoint.segments:
                data = (there.replay_folder / segment.name).read_bytes()
                write_durable(here.replay_folder / segment.name, data)
            fsync_directory(here.replay_folder)
            staging.mkdir(parents=True)
            for path in checkpoint.path.iterdir():
                write_durable(staging / path.name, path.read_bytes())
            fsync_directory(staging)
            staging.rename(here.folder / str(checkpoint.step))
            fsync_directory(here.folder)
        except BaseException:
            shutil.rmtree(staging, ignore_errors=True)
            raise

"""Start one run from another run's checkpoint: the same run with a larger budget."""

from __future__ import annotations

from pathlib import Path

from auvbench.runs.atomic_io import replace_folder, storage, write_atomic
from auvbench.training.checkpoint.store import Checkpoint, CheckpointStore
from auvbench.untrusted import path_safety
from auvbench.untrusted.path_safety import child


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

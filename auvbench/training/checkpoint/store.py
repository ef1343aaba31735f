"""Store checkpoints on disk: named components and a manifest with sizes and hashes.

A checkpoint is written under a hidden name, fsynced, and renamed to `<step>`. Older checkpoints are deleted only
after the renaming, so a run that has written a checkpoint always has a complete checkpoint. A directory named after a step
is complete unless the disk damaged it, which the hashes detect. Nothing is unpickled: tensors are read with
`weights_only=True`, arrays with `allow_pickle=False`, everything else is JSON.
"""

from __future__ import annotations

import shutil
import warnings
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from auvbench.agents.base import Components
from auvbench.errors import AuvbenchWarning, RunError, TrainingError
from auvbench.runs import integrity
from auvbench.runs.atomic_io import as_json, replace_folder, sha256_of_prefix, storage
from auvbench.runs.integrity import FileEntry
from auvbench.training.checkpoint.logs import LogMark
from auvbench.untrusted import reading, typed_json
from auvbench.untrusted.path_safety import child
from auvbench.untrusted.typed_json import Count

SCHEMA_VERSION = 3
READABLE = (2, SCHEMA_VERSION)
"""Schema versions that can be read. Version 2 has the environments' state in other arrays; `Task.load_state_dict` converts them."""
MANIFEST = "manifest.json"
REPLAY = "replay"


class LogMismatchError(ValueError):
    """A log of the run does not match the checkpoint; the checkpoint itself is intact."""


class CheckpointWarning(AuvbenchWarning):
    """A checkpoint could not be used; the message names this checkpoint and the checkpoint that is used instead."""


@dataclass(frozen=True, slots=True)
class Manifest:
    """Content of a checkpoint's manifest.json."""

    schema_version: int
    step: Count
    files: dict[str, FileEntry]
    replay: tuple[Segment, ...]
    logs: dict[str, LogMark]


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """One complete, verified checkpoint."""

    path: Path
    step: int
    components: Components
    segments: tuple[Segment, ...]  # segments of the replay buffer
    logs: dict[str, LogMark]  # path relative to the run -> its length and hash


class CheckpointStore:
    """Folder `checkpoints` of one run, for the process that holds the run's lock.

    Args:
        run: directory of the run.
        keep: number of complete checkpoints to keep, at least 1; with 2, a run survives damage to its newest checkpoint.
    """

    def __init__(self, run: Path, keep: int = 2) -> None:
        self.run = run
        self.folder = run / "checkpoints"
        self.replay_folder = self.folder / REPLAY
        self.keep = keep

    def steps(self) -> list[int]:
        """Return the steps of all checkpoints, newest first; verify nothing."""
        if not self.folder.is_dir():
            return []
        names = (path.name for path in self.folder.iterdir())
        return sorted((int(name) for name in names if name.isascii() and name.isdecimal()), reverse=True)

    def save(
        self,
        step: int,
        components: Components,
        segments: tuple[Segment, ...] = (),
        logs: Mapping[str, LogMark] | None = None,
    ) -> Path:
        """Write a checkpoint, then delete all but the newest `keep` checkpoints; return the new checkpoint's directory.

        Raises:
            TrainingError: the disk is full, read-only or failing; nothing half-written remains, and older
                checkpoints are intact.
        """
        target = self.folder / str(step)
        earlier = self.steps()
        intact = f" (the one of step {earlier[0]} is intact)" if earlier else ""
        with storage(f"cannot write the checkpoint of step {step}{intact}"):
            files = dict(components.files())
            entries = {name: FileEntry(**integrity.entry(data)) for name, data in files.items()}
            manifest = Manifest(SCHEMA_VERSION, step, entries, segments, dict(logs or {}))
            files[MANIFEST] = as_json(integrity.sealed(asdict(manifest)))
            replace_folder(target, files)
        self.prune()
        return target

    def latest_valid(self) -> Checkpoint | None:
        """Return the newest checkpoint whose files, segments and logs all match their hashes; None without one.

        Remove leftovers of a crash. Remove each newer, damaged checkpoint, and name it in a `CheckpointWarning`; the run
        writes it again.

        Raises:
            RunError: the checkpoints are intact, but a log was changed.
            TrainingError: the directory cannot be read or cleaned.
        """
        checkpoint, damaged = self._find()
        with storage(f"cannot clean {self.folder}"):
            self._remove_leftovers()
            for step in damaged:
                self._remove(self.folder / str(step))
        return checkpoint

    def peek(self) -> Checkpoint | None:
        """Return the same checkpoint as `latest_valid`, but remove nothing."""
        return self._find()[0]

    def _find(self) -> tuple[Checkpoint | None, list[int]]:
        """Return the newest intact checkpoint and the steps of newer, damaged checkpoints; warn about each damaged checkpoint."""
        damaged: list[tuple[int, ValueError]] = []
        checkpoint = None
        for step in self.steps():
            try:
                checkpoint = self.read(step)
                break
            except ValueError as error:
                damaged.append((step, error))
        for step, reason in damaged:
            if checkpoint is None and isinstance(reason, LogMismatchError):
                # Starting at step 0 would discard a good checkpoint only because a log was edited.
                raise RunError(
                    f"cannot resume {self.run} at step {step}: {reason}; restore that file, or remove "
                    f"{self.folder} to train from step 0"
                )
        for step, reason in damaged:
            instead = (
                f"the one of step {checkpoint.step}"
                if checkpoint
                else "no older one is whole: starting at step 0"
            )
            warnings.warn(
                f"checkpoint of step {step} in {self.folder} is damaged ({reason}); using {instead}",
                CheckpointWarning,
                stacklevel=3,
            )
        return checkpoint, [step for step, _ in damaged]

    def read(self, step: int) -> Checkpoint:
        """Read and verify one checkpoint.

        Raises:
            ValueError: the checkpoint is damaged; TrainingError: it has another schema version.
        """
        path = self.folder / str(step)
        manifest = _manifest(path)
        recorded = asdict(manifest)
        if manifest.step != step:
            raise ValueError(f"its manifest is of step {manifest.step}")
        contents = {}
        for name in manifest.files:
            try:
                data = reading.content(child(path, name), reading.WEIGHTS)
            except OSError as error:
                raise ValueError(f"{name}: {error.strerror}") from error
            if wrong := integrity.difference(recorded, name, data):
                raise ValueError(f"{name} {wrong}")
            contents[name] = data
        for segment in manifest.replay:
            if not segment.holds(self.replay_folder):
                raise ValueError(f"{REPLAY}/{segment.name} is missing or differs from its hash")
        for name, mark in manifest.logs.items():
            if not mark.holds(child(self.run, name)):
                raise LogMismatchError(
                    f"{name} no longer begins with the {mark.bytes} bytes that it had at the checkpoint"
                )
        return Checkpoint(path, step, Components.read(contents), manifest.replay, manifest.logs)

    def prune(self) -> None:
        """Delete old checkpoints, unused segments and leftovers; on an error, only warn, since the run can continue."""
        try:
            steps = self.steps()
            for step in steps[self.keep :]:
                self._remove(self.folder / str(step))
            if self.replay_folder.is_dir():
                manifests = [_manifest(self.folder / str(step)) for step in steps[: self.keep]]
                names = {segment.name for manifest in manifests for segment in manifest.replay}
                for path in self.replay_folder.iterdir():
                    if path.name not in names:
                        path.unlink(missing_ok=True)
            self._remove_leftovers()  # a checkpoint that could be neither written nor removed leaves files
        except (OSError, ValueError) as error:
            warnings.warn(f"cannot delete old checkpoints in {self.folder}: {error}", CheckpointWarning, 2)

    def _remove(self, path: Path) -> None:
        """Rename a checkpoint's directory, then delete it, so that a half-deleted directory never looks like a checkpoint."""
        aside = path.with_name(f".{path.name}.removed")
        shutil.rmtree(aside, ignore_errors=True)
        path.rename(aside)
        shutil.rmtree(aside)

    def _remove_leftovers(self) -> None:
        """Remove what an interrupted write or removal left behind."""
        if self.folder.is_dir():
            for path in self.folder.glob(".*.*/"):
                shutil.rmtree(path)


def _manifest(path: Path) -> Manifest:
    """Read the manifest of a checkpoint.

    Raises:
        ValueError: the manifest is damaged; TrainingError: it has another schema version.
    """
    try:
        return typed_json.convert(integrity.read_sealed(path / MANIFEST, *READABLE), Manifest)
    except OSError as error:
        raise ValueError(f"{MANIFEST}: {error.strerror}") from error
    except integrity.VersionError as error:
        raise TrainingError(f"{path / MANIFEST} {error}") from error
    except ValueError as error:
        raise ValueError(f"{MANIFEST}: {error}") from error


@dataclass(frozen=True, slots=True)
class Segment:
    """One file with rows of the replay buffer, as recorded in a checkpoint's manifest."""

    first: Count
    last: Count
    """index of the first row after the segment"""
    bytes: Count
    sha256: str

    @property
    def name(self) -> str:
        return f"{self.first:010d}-{self.last:010d}.npz"

    def holds(self, folder: Path) -> bool:
        """Return whether the file exists with the recorded size and hash."""
        path = folder / self.name
        return (
            path.is_file()
            and path.stat().st_size == self.bytes
            and sha256_of_prefix(path, self.bytes) == self.sha256
        )

"""Checkpoints on disk: named components and a manifest with sizes and hashes.

A checkpoint is written in a staging directory beside the others, every file and the directory are fsynced,
and only then is it renamed to `<step>`; the ones before are deleted after that. So at every instant there is a
whole checkpoint (once there was one), and a directory named after a step is complete unless the disk damaged
it, which the hashes tell. Nothing is unpickled on the way back: tensors are read with `weights_only=True`,
arrays with `allow_pickle=False`, everything else is JSON.
"""

from __future__ import annotations

import json
import os
import shutil
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from auvbench.agents.components import Components
from auvbench.errors import AuvbenchWarning, RunError, TrainingError
from auvbench.runs.atomic_io import fsync_directory, make_folder, sha256, storage, write_durable
from auvbench.training.checkpoint.logs import LogMark
from auvbench.training.checkpoint.replay import Segment
from auvbench.untrusted import archives, documents, path_safety, reading

SCHEMA_VERSION = 1
MANIFEST = "manifest.json"
REPLAY = "replay"
_STAGING = ".staging-"
_REMOVED = ".removed-"


class LogMismatchError(ValueError):
    """A log of the run is not what the checkpoint saw; the checkpoint itself is whole."""


class CheckpointWarning(AuvbenchWarning):
    """A checkpoint could not be used; the message names it and says what is used instead."""


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """One complete checkpoint, verified."""

    path: Path
    step: int
    components: Components
    segments: tuple[Segment, ...]  # of the replay buffer
    logs: dict[str, LogMark]  # path relative to the run -> where it was


class CheckpointStore:
    """The folder `checkpoints` of one run. One process at a time: the run's lock sees to that.

    Args:
        run: the run's directory.
        keep: how many complete checkpoints stay, at least 1; 2 survive damage to the newest.
    """

    def __init__(self, run: Path, keep: int = 2) -> None:
        if keep < 1:
            raise ValueError(f"keep={keep}: at least one checkpoint must stay")
        self.run = run
        self.folder = run / "checkpoints"
        self.replay_folder = self.folder / REPLAY
        self.keep = keep

    def steps(self) -> list[int]:
        """The steps of all checkpoints, newest first; nothing is verified."""
        if not self.folder.is_dir():
            return []
        return sorted((int(path.name) for path in self.folder.iterdir() if path.name.isdigit()), reverse=True)

    def save(
        self,
        step: int,
        components: Components,
        segments: tuple[Segment, ...] = (),
        logs: Mapping[str, LogMark] | None = None,
    ) -> Path:
        """Writes a checkpoint; returns its directory. Older ones beyond `keep` go afterwards.

        Raises:
            TrainingError: disk full, read-only or failing; nothing half-written stays, older ones are whole.
        """
        target = self.folder / str(step)
        staging = self.folder / f"{_STAGING}{step}-{os.getpid()}"
        with storage(f"cannot write the checkpoint of step {step}{self._fallback()}"):
            try:
                make_folder(self.folder)
                staging.mkdir()
                manifest: dict[str, Any] = {"schema_version": SCHEMA_VERSION, "step": step, "components": {}}
                for name, data in components.files():
                    write_durable(staging / name, data)
                    manifest["components"][name] = {"bytes": len(data), "sha256": sha256(data)}
                manifest["replay"] = [segment.to_json() for segment in segments]
                manifest["logs"] = {name: mark.to_json() for name, mark in (logs or {}).items()}
                write_durable(staging / MANIFEST, _sealed(manifest))
                fsync_directory(staging)
                if target.exists():
                    self._remove(target)
                staging.rename(target)
                fsync_directory(self.folder)
            except BaseException:
                shutil.rmtree(staging, ignore_errors=True)
                raise
        self.prune()
        return target

    def latest_valid(self) -> Checkpoint | None:
        """The newest checkpoint whose files, segments and logs all match; None where there is none.

        Leftovers of a crash are removed. A damaged checkpoint is named in a `CheckpointWarning` and removed,
        since the run writes it again when it gets there.

        Raises:
            RunError: only a log that somebody changed keeps the checkpoints from being used.
            TrainingError: the directory cannot be read or cleaned.
        """
        found, damaged = self._find()
        with storage(f"cannot clean {self.folder}"):
            self._remove_leftovers()
            for step in damaged:
                self._remove(self.folder / str(step))
        return found

    def peek(self) -> Checkpoint | None:
        """As `latest_valid`, but nothing is removed."""
        return self._find()[0]

    def _find(self) -> tuple[Checkpoint | None, list[int]]:
        """The newest whole checkpoint and the steps of newer ones that are damaged; warns of those."""
        damaged: list[tuple[int, ValueError]] = []
        found = None
        for step in self.steps():
            try:
                found = self.read(step)
                break
            except ValueError as error:
                damaged.append((step, error))
        for step, reason in damaged:
            if found is None and isinstance(reason, LogMismatchError):
                # Starting over would throw away good training for a table that an editor touched.
                raise RunError(
                    f"cannot resume {self.run} at step {step}: {reason}; restore that file, or remove "
                    f"{self.folder} to train from step 0"
                )
        for step, reason in damaged:
            instead = (
                f"the one of step {found.step}" if found else "no older one is whole: starting at step 0"
            )
            warnings.warn(
                f"checkpoint of step {step} in {self.folder} is damaged ({reason}); using {instead}",
                CheckpointWarning,
                stacklevel=3,
            )
        return found, [step for step, _ in damaged]

    def read(self, step: int) -> Checkpoint:
        """Reads and verifies one checkpoint.

        Raises:
            ValueError: what is damaged; TrainingError: it was written by a newer version of auvbench.
        """
        path = self.folder / str(step)
        manifest = _unsealed(path / MANIFEST)
        if manifest["schema_version"] != SCHEMA_VERSION:
            raise TrainingError(
                f"{path} has schema_version {manifest['schema_version']}, this auvbench reads {SCHEMA_VERSION}; "
                "use the version that wrote it"
            )
        if manifest["step"] != step:
            raise ValueError(f"its manifest speaks of step {manifest['step']}")
        contents = {}
        for name, entry in manifest["components"].items():
            try:
                data = reading.content(path_safety.child(path, name), archives.FILE)
            except OSError as error:
                raise ValueError(f"{name}: {error.strerror}") from error
            if len(data) != entry["bytes"]:
                raise ValueError(f"{name} has {len(data)} bytes instead of {entry['bytes']}")
            if sha256(data) != entry["sha256"]:
                raise ValueError(f"{name} differs from its hash")
            contents[name] = data
        segments = tuple(Segment.from_json(entry) for entry in manifest["replay"])
        for segment in segments:
            if not segment.holds(self.replay_folder):
                raise ValueError(f"{REPLAY}/{segment.name} is missing or differs from its hash")
        logs = {name: LogMark.from_json(entry) for name, entry in manifest["logs"].items()}
        for name, mark in logs.items():
            if not mark.holds(self.run / name):
                raise LogMismatchError(
                    f"{name} no longer begins with the {mark.length} bytes that it had then"
                )
        return Checkpoint(path, step, Components.read(contents), segments, logs)

    def _fallback(self) -> str:
        steps = self.steps()
        return f" (the one of step {steps[0]} is intact)" if steps else ""

    def prune(self) -> None:
        """Deletes what no longer counts. Failing here costs disk space, not the run."""
        try:
            steps = self.steps()
            for step in steps[self.keep :]:
                self._remove(self.folder / str(step))
            if self.replay_folder.is_dir():
                self._prune_replay(steps[: self.keep])
            self._remove_leftovers()  # of a checkpoint that could not be written, nor taken away at that time
        except (OSError, ValueError) as error:
            warnings.warn(f"cannot delete old checkpoints in {self.folder}: {error}", CheckpointWarning, 2)

    def _prune_replay(self, steps: list[int]) -> None:
        wanted = {
            Segment.from_json(entry).name
            for step in steps
            for entry in _unsealed(self.folder / str(step) / MANIFEST)["replay"]
        }
        for path in self.replay_folder.iterdir():
            if path.name not in wanted:
                path.unlink(missing_ok=True)

    def _remove(self, path: Path) -> None:
        """Renames before deleting, so that a half-deleted directory never looks like a checkpoint."""
        aside = path.with_name(f"{_REMOVED}{path.name}-{os.getpid()}")
        path.rename(aside)
        shutil.rmtree(aside)

    def _remove_leftovers(self) -> None:
        if not self.folder.is_dir():
            return
        for path in self.folder.iterdir():
            if path.name.startswith((_STAGING, _REMOVED)):
                shutil.rmtree(path)


def _sealed(manifest: dict[str, Any]) -> bytes:
    """The manifest with a hash of itself, so that a flipped bit in a number is noticed too."""
    seal = sha256(json.dumps(manifest, sort_keys=True).encode())
    return json.dumps({**manifest, "sha256": seal}, indent=1).encode()


def _unsealed(path: Path) -> dict[str, Any]:
    """Reads a manifest and checks its own hash; ValueError says what is wrong."""
    try:
        manifest = documents.json_value(reading.content(path))
    except OSError as error:
        raise ValueError(f"{path.name}: {error.strerror}") from error
    except ValueError as error:
        raise ValueError(f"{path.name} is not JSON") from error
    if not isinstance(manifest, dict):
        raise ValueError(f"{path.name} is not a manifest")
    seal = manifest.pop("sha256", None)
    if seal != sha256(json.dumps(manifest, sort_keys=True).encode()):
        raise ValueError(f"{path.name} differs from its hash")
    return manifest

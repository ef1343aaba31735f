"""Read and write the directory of a run, `<output>/<name>/<run id>/`; docs/runs.md describes its layout."""

from __future__ import annotations

import difflib
import shlex
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import yaml

from auvbench.errors import RunError
from auvbench.runs import declared, history, identity, integrity
from auvbench.runs.atomic_io import (
    FAULTS,
    as_json,
    create_atomic,
    make_folder,
    storage_error,
    write_atomic,
    write_json,
)
from auvbench.runs.identity import SCHEMA_VERSION
from auvbench.untrusted import path_safety, reading
from auvbench.untrusted.text import first_line

__all__ = ["RunDirectory", "damaged", "find_runs", "freeze", "now", "place"]

HEADER = (
    "# The resolved configuration of this run. Its hash is part of the folder's name: do not edit;\n"
    "# type the command again with what you want changed.\n"
)


def now() -> str:
    """Return the time in UTC, ISO 8601, to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def damaged(path: Path, why: object, what: str = "run") -> RunError:
    """Return the error for a damaged file of a run or study; the message says what to do."""
    reason = (why.strerror if isinstance(why, OSError) else None) or first_line(why)
    return RunError(f"{path}: damaged: {reason}; restore it, or remove the {what}'s folder")


class RunDirectory:
    """One run on disk.

    Args:
        path: path of the directory; it may not exist yet (see `freeze`).
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self._id = ""

    def __repr__(self) -> str:
        return f"RunDirectory({str(self.path)!r})"

    @property
    def id(self) -> str:
        """Return the id in the manifest; without a valid manifest, return the folder's name, which the user can change."""
        if not self._id:
            try:
                recorded = str(integrity.read(self.manifest_path, integrity.Manifest)["id"])
            except (OSError, ValueError):
                return self.path.name
            # The id becomes part of file paths, so only a plain name is accepted.
            self._id = recorded if path_safety.is_plain(recorded) else self.path.name
        return self._id

    @property
    def config_path(self) -> Path:
        return self.path / "config.yaml"

    @property
    def manifest_path(self) -> Path:
        return self.path / "manifest.json"

    @property
    def train(self) -> Path:
        """Return the folder of the training records, TensorBoard events and the log."""
        return self.path / "train"

    @property
    def model(self) -> Path:
        """Return the folder of the trained weights and statistics."""
        return self.path / "model"

    @property
    def checkpoints(self) -> Path:
        return self.path / "checkpoints"

    def evaluation(self, protocol: str) -> Path:
        """Return the folder of one protocol's results."""
        return self.path / "evaluations" / protocol

    def exists(self) -> bool:
        return self.manifest_path.is_file()

    def config(self) -> dict[str, Any]:
        """Return the resolved configuration as plain Python.

        Raises:
            RunError: the file is missing or not a YAML mapping.
        """
        try:
            loaded = reading.yaml_value(reading.content(self.config_path))
        # ValueError: invalid YAML, invalid UTF-8, or an impossible date
        except (OSError, ValueError) as error:
            raise self._unreadable(self.config_path, error) from error
        if not isinstance(loaded, dict):
            raise self._unreadable(self.config_path, "not a mapping")
        if text := identity.first_interpolation(loaded):
            raise RunError(
                f"{self.config_path}: {text}: the file was edited, since a run's configuration has no ${{...}}; "
                "restore the file, or remove the run's folder"
            )
        return loaded

    def write_config(self, config: Mapping[str, Any]) -> None:
        text = HEADER + yaml.dump(dict(config), Dumper=_DUMPER, sort_keys=False)
        write_atomic(self.config_path, text.encode())

    def manifest(self) -> dict[str, Any]:
        """Return the content of manifest.json.

        Raises:
            RunError: the file is missing, damaged, or has another schema version.
        """
        try:
            return integrity.read(self.manifest_path, integrity.Manifest)
        except integrity.VersionError as error:
            raise RunError(f"{self.manifest_path}: {error}") from error
        except (OSError, ValueError) as error:
            raise self._unreadable(self.manifest_path, error) from error

    def _unreadable(self, path: Path, why: object) -> RunError:
        """Return the error for a missing or damaged file; the message says what to do."""
        if isinstance(why, FileNotFoundError):
            if not self.config_path.is_file() and not self.manifest_path.is_file():
                return RunError(f"{self.path}: is not a run directory ({path.name} is missing)")
            return RunError(f"{path}: missing; restore it, or remove the run's folder")
        return damaged(path, why)

    def update_manifest(self, **changes: Any) -> dict[str, Any]:
        """Write the manifest with some entries replaced, and return it."""
        manifest = integrity.sealed(self.manifest() | changes)
        write_json(self.manifest_path, manifest)
        if "state" in changes:
            history.entered(self.path.absolute().parent, manifest, now())
        return manifest

    def write_model(self, files: Mapping[str, bytes]) -> dict[str, integrity.Entry]:
        """Write the model's files to the disk; return their entries for the manifest.

        Raises:
            OSError: the disk is full, read-only or failing.
        """
        for draft in self.model.glob(
            ".*"
        ):  # temporary files that a kill or power cut left while an earlier attempt wrote the model
            draft.unlink(missing_ok=True)
        for name, data in files.items():
            write_atomic(self.model / name, data)
        return {f"{self.model.name}/{name}": integrity.entry(data) for name, data in files.items()}

    def check(self) -> dict[str, Any]:
        """Return the configuration after checking its hash against the run's id.

        Raises:
            RunError: `config.yaml` was changed since the run was created, or the run contains a link.
        """
        path_safety.refuse_links(self.path)
        config = self.config()
        wrong = identity.mismatch(config, self.id)
        if wrong:
            raise RunError(
                f"{self.path}: config.yaml does not belong to this run: {wrong}. "
                "Restore config.yaml, or type the command with the changed values to create a new run"
            )
        return config


_DUMPER = getattr(yaml, "CSafeDumper", yaml.SafeDumper)


def place(config: Mapping[str, Any]) -> RunDirectory:
    """Return the directory of the run that a resolved configuration describes."""
    return RunDirectory(Path(config["output"]) / config["name"] / identity.run_id(config))


def freeze(config: Mapping[str, Any], command: str = "", analysis: str | None = None) -> RunDirectory:
    """Create and return the directory of a run, with its configuration and a pending manifest; keep an existing directory.

    If the run exists and is incomplete, the new configuration replaces the stored one. The two configurations may
    differ only in keys that are not part of the run's identity.

    Args:
        config: resolved configuration.
        command: command line, for the manifest.
        analysis: digest of the declaration that names the run.

    Raises:
        RunError: the directory has a different configuration, or cannot be written.
        TrainingError: the disk is full or failing.
    """
    run = place(config)
    path_safety.refuse_links(run.path)
    if run.exists():
        frozen = run.config()
        if identity.relevant(frozen) == identity.relevant(config):
            _renew(run, config)
        elif wrong := identity.mismatch(frozen, run.id):
            raise RunError(
                f"{run.path}: config.yaml was changed after the run was created: {wrong}. Restore it, or "
                "remove the directory"
            )
        return run
    try:
        make_folder(run.path)
        run.write_config(config)
        # If two sweeps start at the same time, the second sweep must not overwrite a manifest that the first sweep's worker has updated.
        create_atomic(
            run.manifest_path, as_json(integrity.sealed(_fresh_manifest(run, config, command, analysis)))
        )
    except OSError as error:
        raise unwritable(run.path, error) from error
    return run


def unwritable(path: Path, error: OSError) -> Exception:
    """Return the error for an unwritable path: a TrainingError if the disk is full or failing, else a RunError."""
    if error.errno in FAULTS:
        return storage_error(error, f"cannot write {path}")
    return RunError(f"{path}: cannot be written: {error.strerror or error}")


def _renew(run: RunDirectory, config: Mapping[str, Any]) -> None:
    """Store a new configuration with the same identity in a run, unless the run is complete.

    Raises:
        RunError: the run cannot be written.
    """
    try:
        complete = run.manifest()["state"] == "complete"
    except RunError:
        return  # A damaged manifest is reported when the run is trained.
    if complete or run.config() == config:
        return
    try:
        run.write_config(config)
    except OSError as error:
        raise unwritable(run.path, error) from error


def _fresh_manifest(
    run: RunDirectory, config: Mapping[str, Any], command: str, analysis: str | None
) -> dict[str, Any]:
    return {
        "schema_version": SCHEMA_VERSION,
        "id": run.id,
        "state": "pending",
        "algo": config["algo"]["name"],
        "seed": config["seed"],
        "steps": 0,
        "total_steps": config["train"]["total_steps"],
        "episodes": 0,
        "success_rate": None,
        "created": now(),
        "started": None,
        "ended": None,
        "wall_time_s": 0.0,
        "cpu_time_s": 0.0,
        "phases": {},
        "attempts": 0,
        "error": None,
        "command": command,
        **({} if analysis is None else {declared.KEY: analysis}),
    }


def as_words(runs: Collection[Path], alone: int = 1) -> str:
    """Return command-line arguments that name runs: the runs' folders for up to `alone` runs, else their parent folders.

    While there are more than four folders, each folder is replaced by its parent folder.

    Args:
        runs: folders of the runs.
        alone: largest number of runs for which each run's own folder is named.

    >>> as_words([Path("outputs/a/one")]), as_words([Path("outputs/a/one"), Path("other/b c/two")])
    ('outputs/a/one', "'other/b c' outputs/a")
    """
    folders = set(runs) if len(runs) <= alone else {run.parent for run in runs}
    while len(folders) > 4 and (above := {folder.parent for folder in folders}) != folders:
        folders = above
    return shlex.join(sorted(map(str, folders)))


def find_runs(paths: Iterable[Path | str]) -> list[RunDirectory]:
    """Return all run directories under the given paths, each once, sorted by path.

    Raises:
        RunError: a path does not exist, or has no run.
    """
    runs: dict[Path, RunDirectory] = {}
    for path in map(Path, paths):
        folders = list(folders_of_runs(path))
        if not folders:
            raise RunError(
                f"{path}: is not a run directory and contains none; name a run directory or a folder of runs"
            )
        for run in folders:
            runs.setdefault(run.resolve(), RunDirectory(run))
    return [runs[key] for key in sorted(runs)]


OUTPUTS = Path("outputs")
"""Default folder of runs"""


def missing(path: Path) -> str:
    """Return the error line for a missing path; it suggests a run with a similar id, or a folder with a similar name."""
    runs = sorted(run.parent for run in OUTPUTS.glob("*/*/manifest.json"))
    siblings = [child for child in path.parent.iterdir() if child.is_dir()] if path.parent.is_dir() else []
    for candidates, cutoff in ((runs, 0.8), (siblings, 0.6)):
        names = {candidate.name: candidate for candidate in reversed(candidates)}
        begun = next((name for name in sorted(names) if path.name and name.startswith(path.name)), None)
        near = [begun] if begun else difflib.get_close_matches(path.name, names, n=1, cutoff=cutoff)
        if near:
            return f"{path}: no such file or directory; did you mean {names[near[0]]}?"
    return f"{path}: no such file or directory"


def folders_of_runs(
    path: Path, is_study: Callable[[Path], bool] = lambda folder: False, levels: int = 3
) -> Iterator[Path]:
    """Yield the run directories (also damaged ones) and the published studies below a path, sorted by path.

    The search descends at most `levels` folders: by default root, experiment and run. It therefore does not reach the
    trials of a tuning search, which are deeper. Reports, hidden folders and links are skipped.

    Raises:
        RunError: the path does not exist, or is a file other than a run's manifest.json or config.yaml.
    """
    if not path.exists():
        raise RunError(missing(path))
    if path.is_file():
        if path.name not in ("manifest.json", "config.yaml"):
            raise RunError(f"{path}: is a file, not a run; name a run directory or a folder of runs")
        path = path.parent
    if is_study(path) or (path / "manifest.json").is_file() or (path / "config.yaml").is_file():
        yield path
    elif levels:
        for child in sorted(path.iterdir()):
            if child.is_dir() and not child.is_symlink() and child.name != "report" and child.name[0] != ".":
                yield from folders_of_runs(child, is_study, levels - 1)

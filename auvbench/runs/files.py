"""Writing files so that a crash or a loss of power leaves the old content or the new, never half of it."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from auvbench.runs.atomic_io import fsync_directory, make_folder, storage, write_durable


def write_atomic(path: Path, data: bytes, *, sync_folder: bool = True) -> None:
    """Replaces a file: staged beside it, flushed to disk, renamed into place; on the disk when this returns.

    Args:
        path: the file; its folders are made.
        data: what it is to hold.
        sync_folder: False for whoever writes many files and flushes their folder once, after the last of
            them; until then a loss of power may bring the old content back.
    """
    staged = _stage(path, data)
    try:
        os.replace(staged, path)
    except BaseException:
        staged.unlink(missing_ok=True)
        raise
    if sync_folder:
        fsync_directory(path.parent)


def create_atomic(path: Path, data: bytes) -> bool:
    """Makes a file unless it is there; False when somebody else made it, whose content then stays."""
    staged = _stage(path, data)
    try:
        os.link(staged, path)
    except FileExistsError:
        return False
    except OSError:  # a file system without hard links: the last one wins there
        os.replace(staged, path)
    finally:
        staged.unlink(missing_ok=True)
    fsync_directory(path.parent)
    return True


def _stage(path: Path, data: bytes) -> Path:
    make_folder(path.parent)
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        # mkstemp makes files private; runs are to be read by others.
        os.chmod(name, 0o644)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
    return Path(name)


def write_folder(folder: Path, files: Mapping[str, bytes]) -> None:
    """Makes or replaces a folder: staged beside it and renamed, so that it is there whole or not at all, also
    after a loss of power; what was there stays where the writing fails.

    Args:
        folder: those above it are made.
        files: all that it is to hold, by name.

    Raises:
        TrainingError: the disk is full, read-only or failing.
    """
    staged, former = (folder.with_name(f".{folder.name}.{what}") for what in ("staged", "former"))
    with storage(f"cannot write {folder}"):
        make_folder(folder.parent)
        for leftover in (staged, former):
            shutil.rmtree(leftover, ignore_errors=True)
        staged.mkdir()
        try:
            for name, data in files.items():
                write_durable(staged / name, data)
            fsync_directory(staged)
            if folder.exists():
                folder.rename(former)
            staged.rename(folder)
            fsync_directory(folder.parent)
        finally:
            if former.exists() and not folder.exists():
                former.rename(folder)
            for leftover in (staged, former):
                shutil.rmtree(leftover, ignore_errors=True)


def write_json(path: Path, value: Any) -> None:
    """`write_atomic` of indented JSON; NaN is refused."""
    write_atomic(path, as_json(value))


def as_json(value: Any) -> bytes:
    """Indented JSON; NaN is refused."""
    return (json.dumps(value, indent=2, allow_nan=False) + "\n").encode()


def as_lines(value: Mapping[str, Any]) -> bytes:
    """JSON to be read by people too, in less room: an entry a line, and each item of a list; NaN is refused."""
    lines = []
    for key, entry in value.items():
        if isinstance(entry, list) and entry:
            inner = ",\n".join(f"    {json.dumps(item, allow_nan=False)}" for item in entry)
            text = f"[\n{inner}\n  ]"
        else:
            text = json.dumps(entry, allow_nan=False)
        lines.append(f"  {json.dumps(key)}: {text}")
    return ("{\n" + ",\n".join(lines) + "\n}\n").encode()

"""Writing files so that a crash or a loss of power leaves the old content or the new, never half of it."""

from __future__ import annotations

import json
import os
import tempfile
from pathlib import Path
from typing import Any

from auvbench.runs.durable import fsync_directory, make_folder


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


def write_json(path: Path, value: Any) -> None:
    """`write_atomic` of indented JSON; NaN is refused."""
    write_atomic(path, as_json(value))


def as_json(value: Any) -> bytes:
    """Indented JSON; NaN is refused."""
    return (json.dumps(value, indent=2, allow_nan=False) + "\n").encode()

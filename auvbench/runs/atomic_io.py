"""Write files and folders atomically (write, fsync, rename), and turn disk errors into messages that say what
to do.

A rename within one directory is atomic. The data and the new name are on the disk only after the file and its
directory were fsynced. A function that writes several files therefore fsyncs their directory once, after the
last file.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from auvbench.errors import TrainingError, UserError

_BLOCK = 1 << 20

_REASONS = {
    errno.ENOSPC: "the disk is full; free some space",
    errno.EDQUOT: "the disk quota is used up; free some space",
    errno.EROFS: "the file system is read-only; make it writable",
    errno.EACCES: "permission denied; make the directory writable",
    errno.EPERM: "not permitted; make the directory writable",
    errno.EIO: "the disk reports an input/output error; check the disk",
}

FAULTS = (errno.ENOSPC, errno.EDQUOT, errno.EIO)
"""Errno values of faults that concern the whole disk, not only one directory"""


def storage_error(error: OSError, what: str) -> TrainingError:
    """Return the one-line error for a file or folder that cannot be read or written.

    Args:
        error: exception of the operating system.
        what: what failed, for example "cannot write the checkpoint of step 1000".
    """
    reason = _REASONS.get(error.errno or 0, f"{error.strerror or error}; repair it")
    where = f" ({error.filename})" if error.filename else ""
    return TrainingError(f"{what}{where}: {reason} and run the same command again")


@contextmanager
def storage(what: str) -> Iterator[None]:
    """Convert an `OSError` in the `with` block to the `TrainingError` that `storage_error` returns."""
    try:
        yield
    except OSError as error:
        raise storage_error(error, what) from error


def check_writable(path: Path, typed: str) -> None:
    """Check that a file can be written; create its folder, but do not change the file.

    Args:
        path: path of the file.
        typed: option and path that the user gave, e.g. "--video run.mp4"; the error message begins with this text.

    Raises:
        UserError: the path is not writable.
    """
    if path.is_dir():
        raise UserError(f"{typed}: is a directory, name a file")
    fresh = not path.exists()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.open("ab").close()
    except OSError as error:
        raise UserError(f"{typed}: cannot be written: {error.strerror or error}") from error
    if fresh:
        path.unlink()


def fsync(path: Path) -> None:
    """Flush a file's content, or the file names in a directory, to the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # Some network file systems have no fsync.
            raise
    finally:
        os.close(descriptor)


def make_folder(path: Path) -> None:
    """Create a directory and its parents, and flush their names to the disk."""
    missing = []
    while not path.is_dir():
        missing.append(path)
        path = path.parent
    for folder in reversed(missing):
        folder.mkdir(exist_ok=True)
        fsync(folder.parent)


def write_durable(path: Path, data: bytes) -> None:
    """Write a new file and fsync it."""
    with path.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def write_atomic(path: Path, data: bytes, *, sync_folder: bool = True) -> None:
    """Replace a file: write a temporary file next to it, fsync, rename.

    Args:
        path: path of the file; its folders are created.
        data: new content.
        sync_folder: False if the caller writes many files and fsyncs their folder after the last one.
    """
    staged = _stage(path, data)
    try:
        os.replace(staged, path)
    except BaseException:
        staged.unlink(missing_ok=True)
        raise
    if sync_folder:
        fsync(path.parent)


def create_atomic(path: Path, data: bytes) -> bool:
    """Create a file unless it exists; return False if it existed already."""
    staged = _stage(path, data)
    try:
        os.link(staged, path)
    except FileExistsError:
        return False
    except OSError:  # On a file system without hard links, the file of the last writer remains.
        os.replace(staged, path)
    finally:
        staged.unlink(missing_ok=True)
    fsync(path.parent)
    return True


def _stage(path: Path, data: bytes) -> Path:
    make_folder(path.parent)
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(name, 0o644)  # mkstemp creates private files
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
    return Path(name)


def replace_folder(folder: Path, files: Mapping[str, bytes]) -> None:
    """Create or replace a folder: write its files to a temporary folder, fsync, rename; if that fails, keep the old folder.

    Args:
        folder: path of the folder; its parents are created.
        files: complete content, by file name.

    Raises:
        OSError: the disk is full, read-only or failing.
    """
    staged, former = (folder.with_name(f".{folder.name}.{what}") for what in ("staged", "former"))

    def tidy() -> None:
        # If an earlier replacement was interrupted after it moved the old folder aside, move that folder back.
        if former.exists() and not folder.exists():
            former.rename(folder)
        for leftover in (staged, former):
            shutil.rmtree(leftover, ignore_errors=True)

    make_folder(folder.parent)
    tidy()
    staged.mkdir()
    try:
        for name, data in files.items():
            write_durable(staged / name, data)
        fsync(staged)
        if folder.exists():
            folder.rename(former)
        staged.rename(folder)
        fsync(folder.parent)
    finally:
        tidy()


def write_json(path: Path, value: Any) -> None:
    """Write indented JSON with `write_atomic`; NaN raises an error."""
    write_atomic(path, as_json(value))


def as_json(value: Any) -> bytes:
    """Return indented JSON; NaN raises an error."""
    return (json.dumps(value, indent=2, allow_nan=False) + "\n").encode()


def as_lines(value: Mapping[str, Any]) -> bytes:
    """Return JSON with one line for each entry and for each list item; NaN raises an error."""
    lines = []
    for key, entry in value.items():
        if isinstance(entry, list) and entry:
            inner = ",\n".join(f"    {json.dumps(item, allow_nan=False)}" for item in entry)
            text = f"[\n{inner}\n  ]"
        else:
            text = json.dumps(entry, allow_nan=False)
        lines.append(f"  {json.dumps(key)}: {text}")
    return ("{\n" + ",\n".join(lines) + "\n}\n").encode()


def sha256(data: bytes | memoryview) -> str:
    return hashlib.sha256(data).hexdigest()


def sha256_of_prefix(path: Path, length: int) -> str | None:
    """Return the SHA-256 of the first `length` bytes of a file; None if the file is shorter or cannot be read."""
    digest = hashlib.sha256()
    try:
        with path.open("rb") as file:
            remaining = length
            while remaining > 0:
                block = file.read(min(remaining, _BLOCK))
                if not block:
                    return None
                digest.update(block)
                remaining -= len(block)
    except OSError:
        return None
    return digest.hexdigest()

"""Files and folders that are whole or not there: write, fsync, rename; and errors that say what to do.

A rename within one directory is atomic. Neither the data nor the new name is on the disk before the file and its
directory were fsynced, so a function that writes files fsyncs their directory once, after the last of them.
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
"""faults of the disk itself, in any directory"""


def storage_error(error: OSError, what: str) -> TrainingError:
    """Return the one-line error for a disk that does not take or give its data.

    Args:
        error: what the system reported.
        what: what failed, for instance "cannot write the checkpoint of step 1000".
    """
    reason = _REASONS.get(error.errno or 0, f"{error.strerror or error}; repair it")
    where = f" ({error.filename})" if error.filename else ""
    return TrainingError(f"{what}{where}: {reason} and give the same command again")


@contextmanager
def storage(what: str) -> Iterator[None]:
    """Turn an `OSError` inside into the `TrainingError` of `storage_error`."""
    try:
        yield
    except OSError as error:
        raise storage_error(error, what) from error


def check_writable(path: Path, typed: str) -> None:
    """Check that a file can be written; its folder is made, the file is left as it is.

    Raises:
        UserError: begins with `typed`, what the user wrote.
    """
    if path.is_dir():
        raise UserError(f"{typed}: is a directory, name a file")
    fresh = not path.exists()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.open("ab").close()
    except OSError as error:
        raise UserError(f"{typed}: cannot write there: {error.strerror or error}") from error
    if fresh:
        path.unlink()


def fsync(path: Path) -> None:
    """Put the content of a file, or the names in a directory, on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # some network file systems need no fsync
            raise
    finally:
        os.close(descriptor)


def make_folder(path: Path) -> None:
    """Make a directory and those above it, and put their names on the disk."""
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
        path: the file; its folders are made.
        data: its new content.
        sync_folder: False where the caller writes many files and fsyncs their folder after the last one.
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
    """Make a file unless it exists; return whether this call made it."""
    staged = _stage(path, data)
    try:
        os.link(staged, path)
    except FileExistsError:
        return False
    except OSError:  # a file system without hard links: the last writer wins there
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
        os.chmod(name, 0o644)  # mkstemp makes files private
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
    return Path(name)


def replace_folder(folder: Path, files: Mapping[str, bytes]) -> None:
    """Make or replace a folder: write a new one next to it, fsync, rename; the old one stays where that fails.

    Args:
        folder: those above it are made.
        files: its whole content, by name.

    Raises:
        OSError: the disk is full, read-only or failing.
    """
    staged, former = (folder.with_name(f".{folder.name}.{what}") for what in ("staged", "former"))

    def tidy() -> None:
        if former.exists() and not folder.exists():  # an interrupted replacement had set it aside
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
    """`write_atomic` of indented JSON; NaN is refused."""
    write_atomic(path, as_json(value))


def as_json(value: Any) -> bytes:
    """Return indented JSON; NaN is refused."""
    return (json.dumps(value, indent=2, allow_nan=False) + "\n").encode()


def as_lines(value: Mapping[str, Any]) -> bytes:
    """Return JSON with one line for each entry and for each item of a list; NaN is refused."""
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
    """Return the SHA-256 of the first `length` bytes of a file; None where it is shorter or cannot be read."""
    digest = hashlib.sha256()
    try:
        with path.open("rb") as file:
            left = length
            while left > 0:
                block = file.read(min(left, _BLOCK))
                if not block:
                    return None
                digest.update(block)
                left -= len(block)
    except OSError:
        return None
    return digest.hexdigest()

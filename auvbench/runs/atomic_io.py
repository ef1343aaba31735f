"""Files that are either whole or not there: write, fsync, rename, and errors that say what to do.

A rename within one directory is atomic, but neither the data nor the new name is on the disk before both the
file and its directory were fsynced (POSIX promises no more): whoever writes files here fsyncs their directory
once, after the last of them.
"""

from __future__ import annotations

import errno
import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from auvbench.errors import TrainingError

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
"""The disk's own, whatever directory the user names on it."""


def storage_error(error: OSError, what: str) -> TrainingError:
    """The one line that a user gets when the disk, and not auvbench, is at fault.

    Args:
        error: what the system reported.
        what: what could not be done, for instance "cannot write the checkpoint of step 1000".
    """
    reason = _REASONS.get(error.errno or 0, f"{error.strerror or error}; repair it")
    where = f" ({error.filename})" if error.filename else ""
    return TrainingError(f"{what}{where}: {reason} and give the same command again")


@contextmanager
def storage(what: str) -> Iterator[None]:
    """Turns an `OSError` inside into the `TrainingError` of `storage_error`."""
    try:
        yield
    except OSError as error:
        raise storage_error(error, what) from error


def fsync_directory(path: Path) -> None:
    """Puts the names in a directory on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # some network file systems do it unasked
            raise
    finally:
        os.close(descriptor)


def make_folder(path: Path) -> None:
    """Makes a directory and those above it; their names are on the disk when this returns."""
    missing = []
    while not path.is_dir():
        missing.append(path)
        path = path.parent
    for folder in reversed(missing):
        folder.mkdir(exist_ok=True)
        fsync_directory(folder.parent)


def fsync_file(path: Path) -> None:
    """Puts the content of a file that somebody else wrote on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_durable(path: Path, data: bytes) -> None:
    """Writes a new file and fsyncs it."""
    with path.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def sha256(data: bytes | memoryview) -> str:
    return hashlib.sha256(data).hexdigest()


def sha256_of_prefix(path: Path, length: int) -> str | None:
    """The SHA-256 of the first `length` bytes of a file; None when it is shorter or cannot be read."""
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

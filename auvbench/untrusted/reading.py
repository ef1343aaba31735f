"""Bytes of a regular file of bounded size: never a pipe that does not answer, nor a device without an end."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

DOCUMENT = 16 * 1024**2
"""bytes of the largest manifest, configuration or sheet; ours have some ten thousand"""
DATA = 256 * 1024**2
"""bytes of the largest table or trajectories, unpacked; a million training episodes have 200 million"""
WEIGHTS = 2 * 1024**3
"""bytes of the largest file of a policy or a checkpoint"""


def content(path: Path | str, limit: int = DOCUMENT) -> bytes:
    """Return all bytes of a regular file.

    Raises:
        OSError: it is missing or cannot be read.
        ValueError: it is no regular file, or longer than `limit`.
    """
    # Without O_NONBLOCK, opening a pipe waits for a writer.
    descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0))
    status = os.fstat(descriptor)
    if not stat.S_ISREG(status.st_mode):
        os.close(descriptor)
        if stat.S_ISDIR(status.st_mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        raise ValueError("it is a pipe, a socket or a device, not a file")
    with open(descriptor, "rb") as file:
        data = file.read() if status.st_size <= limit else b""
    if len(data) > limit or status.st_size > limit:
        size = f"{limit // 1024**2} MiB" if limit >= 1024**2 else f"{limit} bytes"
        raise ValueError(f"it has more than {size}, the most that is read")
    return data

"""Tables that may lie compressed: where `NAME.csv` is not there, `NAME.csv.bz2` is read in its place.

Numbers with all their digits are hard to compress: bzip2 takes an eighth less room for them than gzip.
"""

from __future__ import annotations

import bz2
from pathlib import Path

from auvbench.untrusted import reading

SUFFIX = ".bz2"


def beside(path: Path) -> Path | None:
    """The file itself or, where it is not there, its compressed form; None without either."""
    packed = path.with_name(path.name + SUFFIX)
    return next((file for file in (path, packed) if file.is_file()), None)


def content(path: Path, limit: int) -> bytes:
    """As `reading.content`, of the file or of its compressed form, then decompressed.

    Raises:
        OSError: neither is there, or it cannot be read.
        ValueError: it is no regular file, no sound bzip2 file, or longer than `limit`, compressed or not.
    """
    if path.exists() or (file := beside(path)) is None:
        return reading.content(path, limit)
    return unpacked(reading.content(file, limit), limit)


def unpacked(data: bytes, limit: int) -> bytes:
    """What a bzip2 file of one stream holds.

    Raises:
        ValueError: it is damaged or cut short, something follows it, or it holds more than `limit` bytes.

    >>> unpacked(packed(b"a,b"), 10)
    b'a,b'
    """
    stream = bz2.BZ2Decompressor()
    try:
        whole = stream.decompress(data, limit + 1)
    except OSError as error:
        raise ValueError("it is no sound bzip2 file") from error
    if len(whole) > limit:
        raise ValueError(f"it holds more than {limit:,} bytes, the most that is read")
    if not stream.eof or stream.unused_data:
        raise ValueError("the bzip2 file is cut short, or something follows it")
    return whole


def packed(data: bytes) -> bytes:
    """A bzip2 file: the same bytes for the same content, whenever and wherever (no name, no time)."""
    return bz2.compress(data, 9)

"""Tables that may lie compressed: where `NAME.csv` is not there, `NAME.csv.gz` is read in its place."""

from __future__ import annotations

import zlib
from pathlib import Path

from auvbench.untrusted import reading

SUFFIX = ".gz"


def beside(path: Path) -> Path | None:
    """The file itself or, where it is not there, its compressed form; None without either."""
    packed = path.with_name(path.name + SUFFIX)
    return next((file for file in (path, packed) if file.is_file()), None)


def content(path: Path, limit: int) -> bytes:
    """As `reading.content`, of the file or of its compressed form, then decompressed.

    Raises:
        OSError: neither is there, or it cannot be read.
        ValueError: it is no regular file, no sound gzip, or longer than `limit`, compressed or not.
    """
    if path.exists() or (file := beside(path)) is None:
        return reading.content(path, limit)
    return unpacked(reading.content(file, limit), limit)


def unpacked(data: bytes, limit: int) -> bytes:
    """What a gzip file of one member holds.

    Raises:
        ValueError: it is damaged or cut short, something follows it, or it holds more than `limit` bytes.

    >>> unpacked(packed(b"a,b"), 10)
    b'a,b'
    """
    stream = zlib.decompressobj(wbits=31)  # gzip alone
    try:
        whole = stream.decompress(data, limit + 1)
    except zlib.error as error:
        raise ValueError(f"it is no sound gzip file ({error})") from error
    if len(whole) > limit:
        raise ValueError(f"it holds more than {limit:,} bytes, the most that is read")
    if not stream.eof or stream.unused_data:
        raise ValueError("the gzip file is cut short, or something follows it")
    return whole


def packed(data: bytes) -> bytes:
    """A gzip file: the same bytes for the same content, whenever and wherever (no name, no time)."""
    stream = zlib.compressobj(9, wbits=31)
    return stream.compress(data) + stream.flush()

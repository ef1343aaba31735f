"""Arrays and weights from archives that may declare more than any memory holds.

`numpy.load` and `torch.load` make room for what an archive declares: some kilobytes can declare gigabytes. So the
archive's directory is read first; Python's `zipfile` gives no byte more than it says.

Weights, and the arrays of a policy or a checkpoint, are read in this process. They have up to 2 GiB, which a process of
their own would hold a second time, and both readers are bounded: `torch.load` with `weights_only=True` unpickles tensors
alone and unpacks nothing, `numpy.load` is written in Python.
"""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from auvbench.untrusted import reading, sandbox
from auvbench.untrusted.text import first_line

if TYPE_CHECKING:
    from numpy.typing import NDArray

FAULTS = (OSError, ValueError, KeyError, EOFError, MemoryError, zipfile.BadZipFile, zlib.error, RuntimeError)
"""errors of reading a damaged archive"""


def arrays(data: bytes) -> dict[str, NDArray[Any]]:
    """Return all arrays of an .npz; nothing is unpickled.

    Raises:
        ValueError: it is damaged, or declares too much.
    """
    import numpy as np

    declared, limit = sum(_sizes(data)), max(len(data), reading.DATA)
    if declared > limit:
        raise ValueError(f"it would unpack to {declared:,} bytes; at most {limit:,} are read")
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except FAULTS as error:
        raise ValueError(_reason(error)) from error


def paths(data: bytes, condition: str, episodes: Sequence[int] | int) -> dict[str, NDArray[Any]]:
    """Return the arrays `<name>_<condition>_<episode>` of an .npz, read by a process of its own (`sandbox.py`).

    Args:
        data: the file.
        condition: of a protocol.
        episodes: their numbers, or how many of the first ones.

    Raises:
        ValueError: it is damaged, too large, or has arrays that are not of numbers.
    """
    chosen = episodes if isinstance(episodes, int) else list(episodes)
    with sandbox.Child(sandbox.PATHS, data, condition=condition, episodes=chosen) as child:
        return child.answer()[1]


def weights(data: bytes) -> dict[str, Any]:
    """Return a dictionary of tensors that `torch.save` wrote; nothing but tensors is unpickled.

    Raises:
        ValueError: it is damaged, or no such dictionary.
    """
    import torch

    if (declared := sum(_sizes(data))) > len(data):  # torch compresses nothing
        raise ValueError(f"it would unpack to {declared:,} bytes, more than it has")
    try:
        loaded = torch.load(io.BytesIO(data), map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises of all kinds, pickle's among them
        raise ValueError(_reason(error)) from error
    if not isinstance(loaded, dict):
        raise ValueError(f"it holds a {type(loaded).__name__} instead of named tensors")
    return loaded


def _sizes(data: bytes) -> list[int]:
    """Return the unpacked size that the directory of an archive declares for each member.

    Raises:
        ValueError: it is no archive.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            return [member.file_size for member in archive.infolist()]
    except (zipfile.BadZipFile, NotImplementedError, zlib.error) as error:
        raise ValueError(f"it is no archive of arrays ({error})") from error


def _reason(error: BaseException) -> str:
    if isinstance(error, MemoryError):
        return "it declares more than fits into memory"
    return first_line(error)


def members(data: bytes, limit: int) -> Iterator[tuple[str, bytes]]:
    """Yield name and content of the files in a ZIP archive, in its order.

    Args:
        data: the archive.
        limit: bytes that all files together may have.

    Raises:
        ValueError: it is damaged, or unpacks to more.
    """
    if (declared := sum(_sizes(data))) > limit:
        raise ValueError(f"it would unpack to {declared:,} bytes; at most {limit:,} are read")
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            for member in archive.infolist():
                if member.is_dir():
                    continue
                with archive.open(member) as file:
                    content = file.read(member.file_size + 1)
                if len(content) != member.file_size:
                    raise ValueError("a file in it has another size than its directory says")
                yield member.filename, content
    except FAULTS as error:
        raise ValueError(_reason(error)) from error

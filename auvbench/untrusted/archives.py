"""Read arrays and weights from archives that may declare more data than fits into memory.

`numpy.load` and `torch.load` allocate the memory that an archive declares: an archive of some kilobytes can declare
gigabytes. The functions here therefore check the sizes in the archive's directory first; Python's `zipfile` never returns
more bytes than the directory declares.

This process, not a sandbox, reads weights and the arrays of a policy or a checkpoint. These may have up to 2 GiB, and a
separate process would need this memory a second time. Reading them here is safe because of the two readers: `torch.load` with
`weights_only=True` unpickles only tensors and decompresses nothing, and `numpy.load` parses files in Python, not in C.
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
"""exceptions from reading a damaged archive"""


def arrays(data: bytes) -> dict[str, NDArray[Any]]:
    """Return all arrays of an .npz; nothing is unpickled.

    Raises:
        ValueError: the archive is damaged, or would unpack to too many bytes.
    """
    import numpy as np

    declared, limit = sum(_sizes(data)), max(len(data), reading.DATA)
    if declared > limit:
        raise ValueError(f"it would unpack to {declared:,} bytes; the limit is {limit:,}")
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except FAULTS as error:
        raise ValueError(_reason(error)) from error


def paths(data: bytes, condition: str, episodes: Sequence[int] | int) -> dict[str, NDArray[Any]]:
    """Return the arrays `<name>_<condition>_<episode>` of an .npz, read by a separate process (`sandbox.py`).

    Args:
        data: content of the file.
        condition: condition of a protocol.
        episodes: numbers of the episodes as a sequence, or an integer n for the first n episodes.

    Raises:
        ValueError: the file is damaged or too large, or one of the arrays is not of floating-point numbers.
    """
    chosen = episodes if isinstance(episodes, int) else list(episodes)
    with sandbox.Child(sandbox.PATHS, data, condition=condition, episodes=chosen) as child:
        return child.answer()[1]


def weights(data: bytes) -> dict[str, Any]:
    """Return a dictionary of tensors that `torch.save` wrote; only tensors are unpickled.

    Raises:
        ValueError: the file is damaged, or does not contain a dictionary.
    """
    import torch

    if (declared := sum(_sizes(data))) > len(data):  # torch.save does not compress
        raise ValueError(f"it would unpack to {declared:,} bytes, more than the size of the file")
    try:
        loaded = torch.load(io.BytesIO(data), map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises exceptions of many types, also pickle's
        raise ValueError(_reason(error)) from error
    if not isinstance(loaded, dict):
        raise ValueError(f"it contains a {type(loaded).__name__} instead of named tensors")
    return loaded


def _sizes(data: bytes) -> list[int]:
    """Return the unpacked size that the directory of an archive declares for each member.

    Raises:
        ValueError: the file is not an archive.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            return [member.file_size for member in archive.infolist()]
    except (zipfile.BadZipFile, NotImplementedError, zlib.error) as error:
        raise ValueError(f"it is not an archive of arrays ({error})") from error


def _reason(error: BaseException) -> str:
    if isinstance(error, MemoryError):
        return "it declares more than fits into memory"
    return first_line(error)


def members(data: bytes, limit: int) -> Iterator[tuple[str, bytes]]:
    """Yield name and content of each file in a ZIP archive, in the archive's order.

    Args:
        data: content of the archive.
        limit: largest total size in bytes of all files.

    Raises:
        ValueError: the archive is damaged, or unpacks to more than `limit`.
    """
    if (declared := sum(_sizes(data))) > limit:
        raise ValueError(f"it would unpack to {declared:,} bytes; the limit is {limit:,}")
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


def names(data: bytes) -> list[str]:
    """Return the names of the files in an archive.

    Raises:
        ValueError: the archive is damaged.
    """
    _sizes(data)
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return archive.namelist()

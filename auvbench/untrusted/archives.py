"""Arrays and weights from archives that may declare more than any memory holds.

`numpy.load` and `torch.load` make room for what an archive says it holds: seven megabytes of it can say seven
gigabytes. What our own writers make is known beforehand, so the directory of an archive tells what is not theirs.
"""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from auvbench.untrusted.text import first_line

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

FILE = 2 * 1024**3
"""bytes of the largest archive that is read"""
UNPACKED = 1024**3
"""bytes that a compressed archive may unpack to; the trajectories of an evaluation have some megabytes"""

FAULTS = (OSError, ValueError, KeyError, EOFError, MemoryError, zipfile.BadZipFile, zlib.error, RuntimeError)
"""what reading a damaged archive raises"""


def check(data: bytes, *, compressed: bool = False) -> None:
    """Refuses an archive that unpacks to more than `UNPACKED`, or than it holds where nothing is compressed.

    Raises:
        ValueError: it does, or it is no archive.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            declared = sum(member.file_size for member in archive.infolist())
    except (zipfile.BadZipFile, NotImplementedError, zlib.error) as error:
        raise ValueError(f"it is no archive of arrays ({error})") from error
    limit = UNPACKED if compressed else len(data)
    if declared > limit:
        raise ValueError(f"it would unpack to {declared:,} bytes; at most {limit:,} are read")


def arrays(data: bytes) -> dict[str, NDArray[Any]]:
    """All arrays of an uncompressed .npz; nothing is unpickled.

    Raises:
        ValueError: it is damaged, or holds less than it says.
    """
    import numpy as np

    check(data)
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            return {name: np.asarray(archive[name]) for name in archive.files}
    except FAULTS as error:
        raise ValueError(_reason(error)) from error


@contextmanager
def opened(data: bytes) -> Iterator[np.lib.npyio.NpzFile]:
    """A compressed .npz, to read single arrays of; nothing is unpickled.

    Raises:
        ValueError: it is damaged, or unpacks to too much.
    """
    import numpy as np

    check(data, compressed=True)
    with np.load(io.BytesIO(data), allow_pickle=False) as archive:
        yield archive


def weights(data: bytes) -> dict[str, Any]:
    """A dictionary of tensors that `torch.save` wrote; nothing is unpickled but tensors.

    Raises:
        ValueError: it is damaged, or no such dictionary.
    """
    import torch

    check(data)  # torch compresses nothing
    try:
        loaded = torch.load(io.BytesIO(data), map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises of all kinds, pickle's among them
        raise ValueError(_reason(error)) from error
    if not isinstance(loaded, dict):
        raise ValueError(f"it holds a {type(loaded).__name__} instead of named tensors")
    return loaded


def _reason(error: BaseException) -> str:
    if isinstance(error, MemoryError):
        return "it says that it holds more than fits into memory"
    return first_line(error)

"""Arrays and weights from archives that may declare more than any memory holds.

`numpy.load` and `torch.load` make room for what an archive declares: some kilobytes can declare gigabytes. So the
archive's directory is read first.
"""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from auvbench.untrusted import reading
from auvbench.untrusted.text import first_line

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

MEMBER = 32 * 1024**2
"""bytes of an array that is read by itself; the positions of an episode have some ten thousand"""

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


@contextmanager
def opened(data: bytes) -> Iterator[np.lib.npyio.NpzFile]:
    """Open an .npz to read single arrays; nothing is unpickled.

    Raises:
        ValueError: it is damaged, or declares too much.
    """
    import numpy as np

    if (declared := max(_sizes(data), default=0)) > MEMBER:
        raise ValueError(f"an array would unpack to {declared:,} bytes; at most {MEMBER:,} are read")
    with np.load(io.BytesIO(data), allow_pickle=False) as archive:
        yield archive


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

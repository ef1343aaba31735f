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

FAULTS = (OSError, ValueError, KeyError, EOFError, MemoryError, zipfile.BadZipFile, zlib.error, RuntimeError)
"""errors of reading a damaged archive"""


def arrays(data: bytes) -> dict[str, NDArray[Any]]:
    """Return all arrays of an .npz; nothing is unpickled.

    Raises:
        ValueError: it is damaged, or declares too much.
    """
    try:
        with opened(data) as archive:
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

    _check(data)
    with np.load(io.BytesIO(data), allow_pickle=False) as archive:
        yield archive


def weights(data: bytes) -> dict[str, Any]:
    """Return a dictionary of tensors that `torch.save` wrote; nothing but tensors is unpickled.

    Raises:
        ValueError: it is damaged, or no such dictionary.
    """
    import torch

    _check(data)
    try:
        loaded = torch.load(io.BytesIO(data), map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises of all kinds, pickle's among them
        raise ValueError(_reason(error)) from error
    if not isinstance(loaded, dict):
        raise ValueError(f"it holds a {type(loaded).__name__} instead of named tensors")
    return loaded


def _check(data: bytes) -> None:
    """Refuse an archive that unpacks to more than its own size and the limit of data.

    Raises:
        ValueError: it does, or it is no archive.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            declared = sum(member.file_size for member in archive.infolist())
    except (zipfile.BadZipFile, NotImplementedError, zlib.error) as error:
        raise ValueError(f"it is no archive of arrays ({error})") from error
    limit = max(len(data), reading.DATA)
    if declared > limit:
        raise ValueError(f"it would unpack to {declared:,} bytes; at most {limit:,} are read")


def _reason(error: BaseException) -> str:
    if isinstance(error, MemoryError):
        return "it declares more than fits into memory"
    return first_line(error)

"""Tables of comma-separated values from elsewhere."""

from __future__ import annotations

import io
from collections.abc import Collection
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd

LARGEST = 1024**3
"""bytes of the longest table that is read: some million training episodes"""


def csv(data: bytes, only: Collection[str] | None = None, words: Collection[str] = ()) -> pd.DataFrame:
    """The table, or those of the columns `only` that are there; what stands in the columns `words` as it is written.

    Raises:
        ValueError: it is no table.
    """
    import pandas as pd

    wanted = None if only is None else (lambda name: name in only)
    try:
        return pd.read_csv(
            io.BytesIO(data), usecols=wanted, engine="c", low_memory=False, dtype=dict.fromkeys(words, str)
        )
    except (ValueError, OverflowError, MemoryError) as error:  # pandas' own are ValueErrors
        raise ValueError(" ".join(str(error).split()) or type(error).__name__) from error

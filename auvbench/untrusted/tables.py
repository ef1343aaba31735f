"""Tables of comma-separated values that another person may have written."""

from __future__ import annotations

import io
from collections.abc import Collection, Iterable, Mapping
from csv import DictWriter
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd

MISSING = ("", "nan", "NaN", "NA", "N/A", "null", "NULL", "None")
"""texts for a missing number; in a column of words they are words"""


def csv(data: bytes, only: Collection[str] | None = None, words: Collection[str] = ()) -> pd.DataFrame:
    """Return a table, or its columns `only`; the columns `words` stay text.

    Raises:
        ValueError: it is no table.
    """
    import pandas as pd

    wanted = None if only is None else (lambda name: name in only)
    options: dict[str, Any] = {"usecols": wanted, "engine": "c", "low_memory": False}
    try:
        if words:
            header = pd.read_csv(io.BytesIO(data), nrows=0, engine="c").columns
            options["na_values"] = {name: MISSING for name in header if name not in words}
            options |= {"dtype": dict.fromkeys(words, str), "keep_default_na": False}
        found: pd.DataFrame = pd.read_csv(io.BytesIO(data), **options)
        return found
    except (ValueError, OverflowError, MemoryError) as error:  # pandas' own are ValueErrors
        raise ValueError(" ".join(str(error).split()) or type(error).__name__) from error


def text(rows: Iterable[Mapping[str, str]], columns: Collection[str]) -> bytes:
    r"""Return rows as a table of these columns.

    >>> text([{"step": "3", "outcome": "success"}], ["outcome", "step"])
    b'outcome,step\nsuccess,3\n'
    """
    stream = io.StringIO()
    writer = DictWriter(stream, columns, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return stream.getvalue().encode()

"""Read untrusted tables, as Parquet or comma-separated values, with limits on their unpacked size."""

from __future__ import annotations

import io
from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any

from auvbench.untrusted import sandbox, typed_json

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd

FILE = 256 * 1024**2
"""Largest table file in bytes; an unpacked table may have up to `sandbox.MEMORY` bytes"""
COLUMNS = 1000
"""largest number of columns of a table"""
TEXTS = 1_000_000
"""largest number of distinct texts in a column"""
MISSING = ("", "nan", "NaN", "NA", "N/A", "null", "NULL", "None")
"""texts for a missing number; in a text column they are ordinary texts"""


def csv(data: bytes, only: Collection[str] | None = None, words: Collection[str] = ()) -> pd.DataFrame:
    """Return a table of comma-separated values.

    Args:
        data: content of the file.
        only: names of the columns to return; None: all columns.
        words: names of the columns that stay text.

    Raises:
        ValueError: the data are not a table.
    """
    import pandas as pd

    usecols = None if only is None else (lambda name: name in only)
    options: dict[str, Any] = {"usecols": usecols, "engine": "c", "low_memory": False}
    if words:
        options |= {"dtype": dict.fromkeys(words, str), "na_values": MISSING, "keep_default_na": False}
    try:
        table: pd.DataFrame = pd.read_csv(io.BytesIO(data), **options)
        # pandas has read a text such as "nan" as a missing number. In a text column, restore the text.
        if any(table[name].isna().any() for name in words if name in table):
            options["na_values"] = {name: MISSING for name in table if name not in words}
            table = pd.read_csv(io.BytesIO(data), **options)
        return table
    except (ValueError, OverflowError, MemoryError) as error:  # pandas' own exceptions are ValueErrors
        raise ValueError(" ".join(str(error).split()) or type(error).__name__) from error


def read_parquet(data: bytes, columns: Collection[str] | None = None) -> tuple[pd.DataFrame, dict[str, str]]:
    """Return the table in a Parquet file, and the texts in the file's footer by key; text columns become categorical.

    A separate process reads the file (`sandbox.py`).

    Args:
        data: content of the file.
        columns: names of the columns to return; None: all columns.

    Raises:
        ValueError: the file is not Parquet, is damaged, too large, or has nested or unknown types.
    """
    import pandas as pd

    names = None if columns is None else sorted(columns)
    columns_read: dict[str, Any] = {}
    with sandbox.Child(sandbox.TABLE, data, columns=names, most=COLUMNS) as child:
        while "end" not in (answer := child.answer())[0]:
            name = typed_json.convert(answer[0].get("column"), str)
            if name in columns_read or len(columns_read) == COLUMNS:
                raise ValueError("the process that reads it sent a column twice")
            columns_read[name] = _column(answer[1])
    notes = typed_json.convert(answer[0]["end"], dict[str, typed_json.Prose])
    if len({len(values) for values in columns_read.values()}) > 1:
        raise ValueError("the process that reads it sent columns of different lengths")
    return pd.DataFrame(columns_read, copy=False), {name: str(text) for name, text in notes.items()}


def _column(arrays: Mapping[str, np.ndarray[Any, Any]]) -> Any:
    """Return the values of a column (n,): numbers, or a category from codes (n,) and concatenated texts."""
    import numpy as np
    import pandas as pd

    if (values := arrays.get("values")) is not None and values.ndim == 1:
        return values
    codes, ends, text = (arrays.get(name) for name in ("codes", "ends", "text"))
    if codes is None or ends is None or text is None or {codes.ndim, ends.ndim, text.ndim} != {1}:
        raise ValueError("the process that reads it sent an invalid column")
    if len(ends) > TEXTS:
        raise ValueError(f"it has more than {TEXTS:,} different texts in a column")
    if ends.dtype.kind != "i" or (np.diff(ends, prepend=0, append=len(text)) < 0).any():
        raise ValueError("the process that reads it sent texts without lengths")
    encoded, starts = text.tobytes(), [0, *ends[:-1].tolist()]
    words = [encoded[start:end].decode() for start, end in zip(starts, ends.tolist(), strict=True)]
    return pd.Categorical.from_codes(codes, categories=pd.Index(words, dtype="str"))


def parquet(frame: pd.DataFrame, notes: dict[str, str]) -> bytes:
    """Return a table as a Parquet file with zstd and page checksums, and `notes` in its footer."""
    import pyarrow as pa
    from pyarrow.parquet import ParquetWriter

    # Remove the metadata of pandas, so that the bytes do not depend on the version of pandas.
    table = pa.Table.from_pandas(frame, preserve_index=False).replace_schema_metadata(None)
    # Counters and trajectories change little from row to row: delta encoding takes half the bytes of a
    # dictionary.
    delta = {
        field.name: "DELTA_BINARY_PACKED"
        for field in table.schema
        if pa.types.is_integer(field.type) and field.name != "steps"
    }
    sink = pa.BufferOutputStream()
    with ParquetWriter(
        sink,
        table.schema,
        compression="zstd",
        compression_level=19,
        write_page_checksum=True,
        store_schema=False,
        use_dictionary=[name for name in table.schema.names if name not in delta],
        column_encoding=delta or None,
    ) as writer:
        writer.write_table(table)
        writer.add_key_value_metadata(notes)
    result: bytes = sink.getvalue().to_pybytes()
    return result

"""Tables of unknown origin, as Parquet or comma-separated values, with a limit on what they expand to."""

from __future__ import annotations

import io
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from auvbench.untrusted import reading
from auvbench.untrusted.text import short

if TYPE_CHECKING:
    import pandas as pd

FILE = 256 * 1024**2
"""bytes of the largest file"""
VALUES = 200_000_000
"""cells of the largest table: 1.6 GB of float64"""
UNPACKED = 2 * 1024**3
"""bytes of all pages after decompression"""
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
    if words:
        options |= {"dtype": dict.fromkeys(words, str), "na_values": MISSING, "keep_default_na": False}
    try:
        found: pd.DataFrame = pd.read_csv(io.BytesIO(data), **options)
        if any(found[name].isna().any() for name in words if name in found):  # "nan" is a word there
            options["na_values"] = {name: MISSING for name in found if name not in words}
            found = pd.read_csv(io.BytesIO(data), **options)
        return found
    except (ValueError, OverflowError, MemoryError) as error:  # pandas' own are ValueErrors
        raise ValueError(" ".join(str(error).split()) or type(error).__name__) from error


def read_parquet(path: Path) -> tuple[pd.DataFrame, dict[str, str]]:
    """Return a table and the texts of its footer; text columns become categories.

    Raises:
        OSError: the file is missing or cannot be read.
        ValueError: it is no Parquet file, is damaged, too large, or has nested or foreign types.
    """
    import pyarrow as pa
    from pyarrow import parquet

    data = reading.content(path, FILE)
    try:
        footer = parquet.read_metadata(pa.BufferReader(data))
        if footer.num_rows * footer.num_columns > VALUES:
            raise ValueError(f"it has more than {VALUES:,} values")
        if sum(footer.row_group(i).total_byte_size for i in range(footer.num_row_groups)) > UNPACKED:
            raise ValueError(f"it expands to more than {UNPACKED // 1024**3} GiB")
        schema = footer.schema.to_arrow_schema()
        for field in schema:
            if not (pa.types.is_string(field.type) or pa.types.is_primitive(field.type)):
                raise ValueError(f"column {short(field.name, 40)} has the type {short(str(field.type), 40)}")
        texts = [field.name for field in schema if pa.types.is_string(field.type)]
        # One long text may stand in every row: as categories it is in memory once.
        file = parquet.ParquetFile(
            pa.BufferReader(data), read_dictionary=texts, page_checksum_verification=True
        )
        frame: pd.DataFrame = file.read(use_threads=False).to_pandas(ignore_metadata=True)
        found = {key.decode(): value.decode() for key, value in (footer.metadata or {}).items()}
    except (pa.ArrowException, OverflowError, MemoryError, UnicodeDecodeError) as error:
        raise ValueError(f"it is no sound Parquet file: {short(error)}") from error
    return frame, found


def parquet(frame: pd.DataFrame, notes: dict[str, str]) -> bytes:
    """Return a table as a Parquet file with zstd and page checksums; `notes` go into its footer."""
    import pyarrow as pa
    from pyarrow.parquet import ParquetWriter

    # Without pandas' own entry, so that the bytes do not depend on its version.
    table = pa.Table.from_pandas(frame, preserve_index=False).replace_schema_metadata(None)
    # Counters and trajectories change little from row to row: differences take half the bytes of a dictionary.
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

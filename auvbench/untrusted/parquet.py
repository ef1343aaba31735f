"""Parquet files of unknown origin, with a limit on what they expand to."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING

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


def read(path: Path, columns: Collection[str] | None = None) -> tuple[pd.DataFrame, dict[str, str]]:
    """Return a table and the texts of its footer; text columns become categories.

    Args:
        path: of the file.
        columns: the columns to read, if present; None for all.

    Raises:
        OSError: The file is missing or cannot be read.
        ValueError: It is no Parquet file, is damaged, too large, or has nested or foreign types.
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
        wanted = [name for name in schema.names if columns is None or name in columns]
        frame: pd.DataFrame = file.read(columns=wanted, use_threads=False).to_pandas(ignore_metadata=True)
        found = {key.decode(): value.decode() for key, value in (footer.metadata or {}).items()}
    except (pa.ArrowException, OverflowError, MemoryError, UnicodeDecodeError) as error:
        raise ValueError(f"it is no sound Parquet file: {short(error)}") from error
    return frame, found


def written(frame: pd.DataFrame, notes: dict[str, str]) -> bytes:
    """Return a table as a Parquet file with zstd and page checksums; `notes` go into its footer."""
    import pyarrow as pa
    from pyarrow import parquet

    # Without pandas' own entry, so that the bytes do not depend on its version.
    table = pa.Table.from_pandas(frame, preserve_index=False).replace_schema_metadata(None)
    # Counters and trajectories change little from row to row: differences take half the bytes of a dictionary.
    delta = {
        field.name: "DELTA_BINARY_PACKED"
        for field in table.schema
        if pa.types.is_integer(field.type) and field.name != "steps"
    }
    sink = pa.BufferOutputStream()
    with parquet.ParquetWriter(
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

"""Read tables that people wrote, as CSV or parquet, of a bounded number of cells."""

import csv
import io
import re
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from files.bounded import FileError, one_line, read_bytes, read_text

MOST_BYTES = 300_000_000
"""Largest file that is read as a table."""
MOST_CELLS = 50_000_000
"""Most numbers in a table, those within a cell counted."""
MOST_COLUMNS = 2_000
_PARQUET_MAGIC = b"PAR1"
_MEMORY = pa.system_memory_pool()
pa.set_memory_pool(_MEMORY)
_FORMULA = ("=", "+", "-", "@", "\t", "\r")
_INDEX = re.compile(r"__index_level_\d+__")
"""Columns in which pandas keeps the names of rows."""


def read_parquet(path: Path) -> pd.DataFrame:
    """The table in a parquet file; raises FileError, or FileNotFoundError where there is none."""
    data = read_bytes(path, MOST_BYTES)
    if data[:4] != _PARQUET_MAGIC:
        raise FileError(f"{path} is not a parquet file; write it again, or as CSV")
    if len(data) < 12 or data[-4:] != _PARQUET_MAGIC:
        raise FileError(f"{path} is incomplete: its end is missing; copy or record it again")
    try:
        file = pq.ParquetFile(pa.BufferReader(data))
        _refuse_large(path, _cells(file.metadata), len(file.schema_arrow.names))
        table = file.read().replace_schema_metadata()  # pandas' own, which nobody needs
        frame = table.to_pandas(self_destruct=True)
        del table, file
    except FileError:
        raise
    except (pa.ArrowException, OSError, OverflowError, ValueError) as error:
        said = one_line(str(error))
        raise FileError(f"{path} is damaged: {said}; copy or record it again") from None
    return frame[[name for name in frame.columns if not _INDEX.fullmatch(str(name))]]


def give_back() -> None:
    """Give memory that nobody needs after large tables were read back to the system."""
    _MEMORY.release_unused()


def read_csv(path: Path, **options: Any) -> pd.DataFrame:
    """The table in a CSV file; raises FileError, or FileNotFoundError where there is none."""
    return parse_csv(path, read_text(path, MOST_BYTES).encode(), **options)


def _without_huge(frame: pd.DataFrame) -> pd.DataFrame:
    """The table with integers that no float can hold as text, which reads as infinite."""
    mixed = frame.select_dtypes(object)
    huge = [name for name in mixed if mixed[name].map(type).eq(int).any()]
    return frame.astype(dict.fromkeys(huge, str))


def parse_csv(path: Path, data: bytes, **options: Any) -> pd.DataFrame:
    """The table in a CSV file's text in UTF-8; raises FileError."""
    columns = data.count(b",", 0, data.find(b"\n") + 1 or None) + 1
    _refuse_large(path, columns * data.count(b"\n"), columns)
    if not data or data.isspace():
        raise FileError(f"{path} is empty; it should hold a table with a header")
    try:
        return _without_huge(pd.read_csv(io.BytesIO(data), **options))
    except (pd.errors.ParserError, ValueError, csv.Error, OverflowError) as error:
        raise FileError(f"{path}: {one_line(str(error))}; correct or remove that line") from None


def _cells(meta: pq.FileMetaData) -> int:
    """Numbers in a parquet file, by what it says of itself."""
    groups = (meta.row_group(k) for k in range(meta.num_row_groups))
    return sum(
        max(group.column(k).num_values, group.num_rows)
        for group in groups
        for k in range(group.num_columns)
    )


def _refuse_large(path: Path, cells: int, columns: int) -> None:
    if cells > MOST_CELLS or columns > MOST_COLUMNS:
        raise FileError(
            f"{path} has {columns} columns and {cells} values; allowed: up to {MOST_COLUMNS} and "
            f"{MOST_CELLS}; cut it into several"
        )


def csv_text(frame: pd.DataFrame, **options: Any) -> str:
    """A table as CSV; a text that a spreadsheet would take for a formula begins with '."""
    plain = frame.copy()
    for name in plain.select_dtypes(exclude="number").columns:
        plain[name] = [plain_cell(cell) for cell in plain[name]]
    return plain.to_csv(index=False, lineterminator="\n", **options)


def plain_cell(cell: object) -> object:
    """A cell that no spreadsheet takes for a formula."""
    return f"'{cell}" if isinstance(cell, str) and cell.startswith(_FORMULA) else cell

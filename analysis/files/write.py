"""Writing a file that is not there yet: a table as CSV or Parquet, or whatever a writer puts into it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

import pyarrow as pa
import pyarrow.parquet as pq

from rigs.errors import CellError, FileError
from rigs.text import plain_lines


def write_new(path: Path, write: Callable[[BinaryIO], None]) -> None:
    """Make a file by `write`, whole or not at all.

    Raises FileError where it exists already or cannot be made, CellError when the disk refuses.
    """
    try:
        file = path.open("xb")
    except FileExistsError:
        raise FileError(str(path), "exists already", "give another --output, or remove it first") from None
    except OSError as error:
        raise FileError(str(path), error.strerror or str(error), "give another --output") from None
    try:
        with file:
            write(file)
    except BaseException as error:
        with suppress(OSError):
            path.unlink()
        if isinstance(error, OSError):
            what = f"cannot be written: {error.strerror or error}"
            raise CellError(str(path), what, "free some space or choose another disk") from error
        raise


def write_new_bytes(path: Path, data: bytes) -> None:
    """Make a file that holds `data`, like `write_new`."""

    def write(file: BinaryIO) -> None:
        file.write(data)

    write_new(path, write)


def write_parquet(table: pa.Table, file: BinaryIO) -> None:
    """The table as Parquet, without the store's own notes."""
    pq.write_table(table.replace_schema_metadata(None), file, compression="zstd")


def write_csv(table: pa.Table, file: BinaryIO) -> None:
    """The table as UTF-8 with a header and commas; every number in the fewest digits that give it back.

    Text is plain (`rigs.text`), line feeds in it stay; Parquet keeps it as it was.
    """
    columns = [[_cell(value) for value in column.to_pylist()] for column in table.columns]
    file.write((",".join(map(_quoted, table.column_names)) + "\n").encode())
    for row in zip(*columns, strict=True):
        file.write((",".join(row) + "\n").encode())


def _cell(value: Any) -> str:
    return _quoted(value) if isinstance(value, str) else repr(value)


def _quoted(text: str) -> str:
    text = plain_lines(text)
    if any(mark in text for mark in ',"\n'):
        return '"' + text.replace('"', '""') + '"'
    return text

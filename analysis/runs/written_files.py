"""Writing of files in CSV, Parquet and other formats, with a common rule for existing files.

Files that record or decide something are never replaced. Files that only show runs, such as pages, pictures and tables
of figures, are replaced if rig made the existing file (docs/decisions/0034-existing-files.md).

In a table from elsewhere, a note may contain a formula such as `=cmd|…`, which a spreadsheet would execute. In a CSV
file such a cell gets a leading apostrophe, which marks text for a spreadsheet. The apostrophe is removed when the CSV
file is read, so a table is unchanged after writing and reading. Numbers are never marked.
"""

from __future__ import annotations

import csv
import io
import math
import os
import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from daq.store.run_directory import files_into
from rigs.distribution import to_install
from rigs.errors import CellError, FileError
from rigs.files import read_from
from rigs.signals import REPLACED
from rigs.text import escape_lines

if TYPE_CHECKING:
    import pyarrow as pa


_ENDS = 65536
"""Number of bytes at each end of a file that are searched for marks. The schema of the widest table has 3 kB."""
PDF_MARK = b"% made by rig\n"
"""Comment at the end of a PDF made by rig. WeasyPrint 70 compresses the metadata with the producer's name."""
_MARKS: dict[str, tuple[bytes, tuple[bytes, ...]]] = {
    ".html": (b"<!doctype html>", (b"content=\"default-src 'none'; base-uri 'none'; form-action 'none'",)),
    ".pdf": (b"%PDF-", (PDF_MARK,)),
    ".png": (b"\x89PNG\r\n", (b"Matplotlib",)),
    ".parquet": (b"PAR1", (b"started_utc", b"standing")),
}
"""For each suffix: first bytes of a file, and marks near the start or end of a file made by rig."""


def refuse_existing(path: Path) -> None:
    """Raise FileError before any computation if the path exists, for a file that records or decides something."""
    if os.path.lexists(path):
        raise _exists(path)


def refuse_foreign(path: Path, option: str = "--output") -> None:
    """Raise FileError if the path exists and is not a page, picture or table of figures made by rig.

    Otherwise an existing file is noted in `REPLACED`.
    """
    try:
        begin, size = read_from(path, 0, _ENDS)
        end = begin if size <= _ENDS else read_from(path, size - _ENDS, _ENDS)[0]
    except FileNotFoundError:
        return
    except FileError as error:  # not a regular file
        raise FileError(error.where, error.what, f"choose a different {option}", code="file.unreadable") from None
    except OSError as error:
        raise FileError(
            str(path), error.strerror or str(error), f"choose a different {option}", code="output.not_writable"
        ) from None
    suffix = {".htm": ".html"}.get(path.suffix.lower(), path.suffix.lower())
    first, marks = _MARKS.get(suffix, _MARKS[".parquet"])  # a table may have any name
    is_of_rig = begin.lstrip().startswith(first) and all(mark in begin or mark in end for mark in marks)
    if size and not is_of_rig:
        problem = "already exists, and was not created by rig"
        raise FileError(str(path), problem, f"choose a different {option}, or remove it first", code="output.exists")
    REPLACED.add(path)


_FORMULA = re.compile(r"'*[=+\-@\t\r]")
_WRITTEN = re.compile(r"'+[=+\-@\t\r]")
_NUMBER = re.compile(r"-?[0-9]+(\.[0-9]+)?([eE][+-]?[0-9]+)?")


def no_formula(text: str) -> str:
    return f"'{text}" if _FORMULA.match(text) and not _NUMBER.fullmatch(text) else text


def as_it_was(text: str) -> str:
    """Remove the mark added by `no_formula`."""
    return text[1:] if _WRITTEN.match(text) else text


ROWS_AT_ONCE = 65_536
"""Number of table rows converted to Python numbers at once. They need about ten times the memory of an array."""
_SHEET_ROWS = 1_048_576
"""Rows of a sheet including the header (Microsoft, Excel specifications and limits)."""
Writer = Callable[[BinaryIO], object]
"""Function that writes the content of a file."""


def holding(data: bytes) -> Writer:
    return lambda file: file.write(data)


def write_all_new(directory: Path, files: Mapping[str, Writer]) -> list[Path]:
    """Create files by name in a directory, all or none.

    Raises FileError if a file exists or cannot be created, and CellError if the disk refuses.
    """
    return _write_all(directory, files, over=False)


def write_all_over(directory: Path, files: Mapping[str, Writer]) -> list[Path]:
    """Like `write_all_new`, replacing existing files; each is completely old or completely new."""
    return _write_all(directory, files, over=True)


def write_views(directory: Path, files: Mapping[str, Writer]) -> list[Path]:
    """Create pictures, replacing earlier ones made by rig.

    Raises FileError for any other existing file, and the errors of `write_all_new`.
    """
    for name in files:
        refuse_foreign(directory / name, "--plot")
    return _write_all(directory, files, over=True)


def _write_all(directory: Path, files: Mapping[str, Writer], *, over: bool) -> list[Path]:
    paths = [directory / name for name in files]
    for path in () if over else paths:
        refuse_existing(path)
    made, where = False, str(paths[0] if len(paths) == 1 else directory)
    remedy = "choose a different --plot" if over else "choose a different --output"
    try:
        with files_into(directory, over=over) as hidden:
            made = True
            for name, write in files.items():
                (hidden / name).parent.mkdir(parents=True, exist_ok=True)
                with (hidden / name).open("xb") as file:
                    write(file)
    except FileExistsError as error:
        raise _exists(Path(error.filename or directory)) from None
    except OSError as error:
        if made:
            problem = f"cannot be written: {error.strerror or error}"
            raise CellError(where, problem, "free some space or choose a different disk", code="disk.full") from error
        raise FileError(where, error.strerror or str(error), remedy, code="output.not_writable") from None
    return paths


def write_new(path: Path, write: Writer) -> None:
    write_all_new(path.parent, {path.name: write})


def _exists(path: Path) -> FileError:
    return FileError(
        str(path), "exists already", "choose a different --output, or remove it first", code="output.exists"
    )


def write_parquet(table: pa.Table, file: BinaryIO) -> None:
    import pyarrow.parquet as pq  # noqa: PLC0415 - slow to import, needed for Parquet only

    pq.write_table(table.replace_schema_metadata(None), file, compression="zstd")


def csv_text(rows: Iterable[Iterable[object]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def write_csv(table: pa.Table, file: BinaryIO) -> None:
    """Write a UTF-8 CSV with the fewest digits that reproduce each number.

    Text is sanitised (`rigs.text`) except for line feeds, and gets an apostrophe if a spreadsheet would take it for a
    formula.
    """
    file.write((",".join(map(_quoted, table.column_names)) + "\n").encode())
    for batch in table.to_batches(max_chunksize=ROWS_AT_ONCE):
        columns = (column.to_pylist() for column in batch.columns)
        texts = [[_quoted(cell) if isinstance(cell, str) else repr(cell) for cell in column] for column in columns]
        file.writelines((",".join(row) + "\n").encode() for row in zip(*texts, strict=True))


def write_xlsx(table: pa.Table, file: BinaryIO) -> None:
    """Write a workbook with one sheet and a frozen header; text never becomes a formula or a link.

    Raises FileError if the table has more rows than a sheet, and CellError if the library is missing.
    """
    try:
        import openpyxl  # noqa: PLC0415 - an extra, and slow to import
    except ModuleNotFoundError:
        raise CellError(
            "xlsx",
            "needs the Python package openpyxl, which is not installed",
            to_install("openpyxl"),
            code="package.missing",
        ) from None
    if table.num_rows >= _SHEET_ROWS:
        problem = f"has {table.num_rows} rows, but a sheet can contain only {_SHEET_ROWS - 1}"
        raise FileError("xlsx", problem, "export the run as csv or parquet", code="output.invalid")
    book = openpyxl.Workbook(write_only=True)
    sheet = book.create_sheet("table")
    sheet.freeze_panes = "A2"
    sheet.append([_in_sheet(sheet, name) for name in table.column_names])
    for batch in table.to_batches(max_chunksize=ROWS_AT_ONCE):
        for row in zip(*(column.to_pylist() for column in batch.columns), strict=True):
            sheet.append([_in_sheet(sheet, value) for value in row])
    book.save(file)


def _in_sheet(sheet: Any, value: Any) -> Any:
    if isinstance(value, str):
        from openpyxl.cell import WriteOnlyCell  # noqa: PLC0415

        cell = WriteOnlyCell(sheet, escape_lines(value))
        cell.data_type = "s"  # also for text that looks like a formula
        return cell
    return value if value is not None and math.isfinite(value) else None


def _quoted(text: str) -> str:
    text = no_formula(escape_lines(text))
    if any(mark in text for mark in ',"\n'):
        return '"' + text.replace('"', '""') + '"'
    return text

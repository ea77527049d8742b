"""Writing files in CSV, Parquet or any format, with a common rule for existing files.

Files that record or decide something are never replaced. Files that only show runs, such as pages, pictures and tables
of figures, are replaced under the same name if rig made the existing file (docs/decisions/0034-existing-files.md).

A table from elsewhere may contain `=cmd|…` in a note, which a spreadsheet would compute. Such a cell of a CSV file gets
a leading apostrophe, which marks text for a spreadsheet; reading a CSV file removes it again, and a table written and
read is therefore unchanged. Numbers are not text and remain unchanged.
"""

from __future__ import annotations

import math
import os
import re
import secrets
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from daq.store.run_directory import files_into, surely
from rigs.distribution import to_install
from rigs.errors import CellError, FileError
from rigs.files import read_from
from rigs.text import plain_lines

if TYPE_CHECKING:
    import pyarrow as pa


_ENDS = 65536
"""Bytes at either end of a file by which it is known: the schema of the widest table that is written has 3 kB."""
PDF_MARK = b"% made by rig\n"
"""A comment at the end of a PDF made by rig: WeasyPrint 70 compresses the metadata naming the producer."""
_MARKS: dict[str, tuple[bytes, tuple[bytes, ...]]] = {
    ".html": (b"<!doctype html>", (b"content=\"default-src 'none'; base-uri 'none'; form-action 'none'",)),
    ".pdf": (b"%PDF-", (PDF_MARK,)),
    ".png": (b"\x89PNG\r\n", (b"Matplotlib",)),
    ".parquet": (b"PAR1", (b"started_utc", b"standing")),
}
"""Initial bytes of a file, by suffix, and bytes near the start or end of such files made by rig."""


def refuse_existing(path: Path, option: str = "--output") -> None:
    """Raise FileError if a path has the name of a file that records or decides something, before anything is
    computed. option: the option for another name."""
    if os.path.lexists(path):
        raise FileError(str(path), "exists already", f"choose a different {option}, or remove it first")


def refuse_foreign(path: Path, option: str = "--output") -> None:
    """Raise FileError if the path exists as a page, picture or table of figures not made by rig."""
    try:
        begin, size = read_from(path, 0, _ENDS)
        end = begin if size <= _ENDS else read_from(path, size - _ENDS, _ENDS)[0]
    except FileNotFoundError:
        return
    except FileError as error:  # no regular file
        raise FileError(error.where, error.what, f"choose a different {option}") from None
    except OSError as error:
        raise FileError(str(path), error.strerror or str(error), f"choose a different {option}") from None
    suffix = {".htm": ".html"}.get(path.suffix.lower(), path.suffix.lower())
    first, marks = _MARKS.get(suffix, _MARKS[".parquet"])  # a table may have any name
    is_of_rig = begin.lstrip().startswith(first) and all(mark in begin or mark in end for mark in marks)
    if size and not is_of_rig:
        problem = "exists already, and rig did not make it"
        raise FileError(str(path), problem, f"choose a different {option}, or remove it first")


_FORMULA = re.compile(r"'*[=+\-@\t\r]")
_WRITTEN = re.compile(r"'+[=+\-@\t\r]")
_NUMBER = re.compile(r"-?[0-9]+(\.[0-9]+)?([eE][+-]?[0-9]+)?")


def no_formula(text: str) -> str:
    """Text as no program computes it."""
    return f"'{text}" if _FORMULA.match(text) and not _NUMBER.fullmatch(text) else text


def as_it_was(text: str) -> str:
    """Text that `no_formula` wrote, as it was before."""
    return text[1:] if _WRITTEN.match(text) else text


ROWS_AT_ONCE = 65_536
"""Rows of a table in memory as Python numbers, which use some ten times the memory of an array."""
_SHEET_ROWS = 1_048_576
"""Rows of a sheet, including the header (Excel specifications and limits, Microsoft)."""
Writer = Callable[[BinaryIO], object]
"""Function writing the content of a file into it."""


def holding(data: bytes) -> Writer:
    """Return the writer of a file with these bytes as content."""
    return lambda file: file.write(data)


def write_all_new(directory: Path, files: Mapping[str, Writer]) -> list[Path]:
    """Create files by name in a directory, which is created if missing: all of them or none.

    Raises FileError if a file exists already or cannot be created, CellError if the disk refuses.
    """
    return _write_all(directory, files, over=False)


def write_all_over(directory: Path, files: Mapping[str, Writer]) -> list[Path]:
    """Create files like `write_all_new`, replacing existing ones: each is completely the old or the new file."""
    return _write_all(directory, files, over=True)


def write_views(directory: Path, files: Mapping[str, Writer]) -> list[Path]:
    """Create pictures by name in a directory, replacing earlier ones of rig. Raises FileError for any other existing
    file, and the errors of `write_all_new`."""
    for name in files:
        refuse_foreign(directory / name, "--plot")
    return _write_all(directory, files, over=True)


def _write_all(directory: Path, files: Mapping[str, Writer], *, over: bool) -> list[Path]:
    paths = [directory / name for name in files]
    for path in () if over else paths:
        refuse_existing(path)
    made, remedy = False, "choose a different --plot" if over else "choose a different --output"
    try:
        with files_into(directory, over=over) as hidden:
            made = True
            for name, write in files.items():
                with (hidden / name).open("xb") as file:
                    write(file)
    except FileExistsError as error:
        raise _exists(Path(error.filename or directory)) from None
    except OSError as error:
        if made:
            problem = f"cannot be written: {error.strerror or error}"
            raise CellError(str(directory), problem, "free some space or choose another disk") from error
        raise FileError(str(directory), error.strerror or str(error), remedy) from None
    return paths


def write_new(path: Path, write: Writer) -> None:
    """Create a file by `write`, completely or not at all: until it is complete it has another name.

    Raises FileError if it exists already or cannot be created, CellError if the disk refuses.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise FileError(
            str(path.parent), "is a file, and a directory is needed", "choose a different --output"
        ) from None
    except OSError as error:
        raise FileError(str(path.parent), error.strerror or str(error), "choose a different --output") from None
    try:
        _hold_free(path)
    except FileExistsError:
        raise _exists(path) from None
    temporary, opened = path.with_name(f".{secrets.token_hex(8)}.tmp"), False
    try:
        with temporary.open("xb") as file:
            opened = True
            write(file)
        try:
            path.hardlink_to(temporary)
        except FileExistsError:
            raise
        except OSError:  # memory sticks and some network shares have no links
            _hold_free(path)
            temporary.rename(path)
    except FileExistsError:
        raise _exists(path) from None
    except OSError as error:
        if not opened:
            raise FileError(str(path), error.strerror or str(error), "choose a different --output") from None
        problem = f"cannot be written: {error.strerror or error}"
        raise CellError(str(path), problem, "free some space or choose another disk") from error
    finally:
        with suppress(OSError):
            surely(lambda: temporary.unlink(missing_ok=True))


def _hold_free(path: Path) -> None:
    if os.path.lexists(path):
        raise FileExistsError(path)


def _exists(path: Path) -> FileError:
    return FileError(str(path), "exists already", "choose a different --output, or remove it first")


def write_parquet(table: pa.Table, file: BinaryIO) -> None:
    """Write the table as Parquet, excluding the metadata of the store."""
    import pyarrow.parquet as pq  # noqa: PLC0415 - slow to import, needed for Parquet only

    pq.write_table(table.replace_schema_metadata(None), file, compression="zstd")


def write_csv(table: pa.Table, file: BinaryIO) -> None:
    """Write the table as UTF-8 CSV with a header; every number in the fewest digits that reproduce it.

    Text is plain (`rigs.text`) and keeps line feeds; text that a spreadsheet interprets as a formula has a leading
    apostrophe, as those programs write it. Parquet keeps text unchanged.
    """
    file.write((",".join(map(_quoted, table.column_names)) + "\n").encode())
    for batch in table.to_batches(max_chunksize=ROWS_AT_ONCE):
        columns = (column.to_pylist() for column in batch.columns)
        texts = [[_quoted(cell) if isinstance(cell, str) else repr(cell) for cell in column] for column in columns]
        file.writelines((",".join(row) + "\n").encode() for row in zip(*texts, strict=True))


def write_xlsx(table: pa.Table, file: BinaryIO) -> None:
    """Write the table as a workbook with a single sheet and a frozen header; text is text, never a formula or a link.

    Raises FileError for more rows than a sheet has, and CellError if the library is missing.
    """
    try:
        import openpyxl  # noqa: PLC0415 - an extra, and slow to import
    except ModuleNotFoundError:
        raise CellError("xlsx", "needs openpyxl, which is not installed", to_install("openpyxl")) from None
    if table.num_rows >= _SHEET_ROWS:
        problem = f"has {table.num_rows} rows, and a sheet holds {_SHEET_ROWS - 1}"
        raise FileError("xlsx", problem, "export it as csv or parquet")
    book = openpyxl.Workbook(write_only=True)
    sheet = book.create_sheet("table")
    sheet.freeze_panes = "A2"
    sheet.append([_in_sheet(sheet, name) for name in table.column_names])
    for batch in table.to_batches(max_chunksize=ROWS_AT_ONCE):
        for row in zip(*(column.to_pylist() for column in batch.columns), strict=True):
            sheet.append([_in_sheet(sheet, value) for value in row])
    book.save(file)


def _in_sheet(sheet: Any, value: Any) -> Any:
    """Return the content of a cell of a sheet; unknown values leave it empty."""
    if isinstance(value, str):
        from openpyxl.cell import WriteOnlyCell  # noqa: PLC0415

        cell = WriteOnlyCell(sheet, plain_lines(value))
        cell.data_type = "s"  # also for text that looks like a formula
        return cell
    return value if value is not None and math.isfinite(value) else None


def _quoted(text: str) -> str:
    text = no_formula(plain_lines(text))
    if any(mark in text for mark in ',"\n'):
        return '"' + text.replace('"', '""') + '"'
    return text

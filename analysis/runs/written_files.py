"""Writing files, as CSV, Parquet or whatever a writer puts into them, by the one rule for those that are there already.

What records or decides something is never replaced. What only shows runs, pages, pictures and tables of figures, is
made again under its name, where rig made what is there (docs/decisions/0034-existing-files.md).

A table from elsewhere may hold `=cmd|…` in a note, which a spreadsheet would compute. Such a cell of a CSV file gets an
apostrophe as its first character, by which a spreadsheet knows text; what is read from a CSV file loses it again, so
that a table that goes out and comes back is the same. Numbers are no text, and stay as they are.
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
"""A comment at the end of a PDF of rig: WeasyPrint 70 compresses what names the maker of one."""
_MARKS: dict[str, tuple[bytes, tuple[bytes, ...]]] = {
    ".html": (b"<!doctype html>", (b"content=\"default-src 'none'; base-uri 'none'; form-action 'none'",)),
    ".pdf": (b"%PDF-", (PDF_MARK,)),
    ".png": (b"\x89PNG\r\n", (b"Matplotlib",)),
    ".parquet": (b"PAR1", (b"started_utc", b"standing")),
}
"""What a file begins with, by its ending, and what such files of rig hold near their begin or end."""


def refuse_existing(path: Path, option: str = "--output") -> None:
    """Raise FileError where something has the name of a file that records or decides something, before anything is
    computed. option: what gives it another name."""
    if os.path.lexists(path):
        raise FileError(str(path), "exists already", f"give another {option}, or remove it first")


def refuse_foreign(path: Path, option: str = "--output") -> None:
    """Raise FileError where something has the name of a page, a picture or a table of figures that rig did not make."""
    try:
        begin, size = read_from(path, 0, _ENDS)
        end = begin if size <= _ENDS else read_from(path, size - _ENDS, _ENDS)[0]
    except FileNotFoundError:
        return
    except FileError as error:  # no regular file
        raise FileError(error.where, error.what, f"give another {option}") from None
    except OSError as error:
        raise FileError(str(path), error.strerror or str(error), f"give another {option}") from None
    suffix = {".htm": ".html"}.get(path.suffix.lower(), path.suffix.lower())
    first, marks = _MARKS.get(suffix, _MARKS[".parquet"])  # a table may have any name
    is_of_rig = begin.lstrip().startswith(first) and all(mark in begin or mark in end for mark in marks)
    if size and not is_of_rig:
        problem = "exists already, and rig did not make it"
        raise FileError(str(path), problem, f"give another {option}, or remove it first")


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
"""Rows of a table that are in memory as Python's own numbers, which take some ten times the memory of an array's."""
_SHEET_ROWS = 1_048_576
"""Rows of a sheet, its header among them (Excel specifications and limits, Microsoft)."""
Writer = Callable[[BinaryIO], object]
"""Puts what a file holds into it."""


def holding(data: bytes) -> Writer:
    """Return the writer of a file that holds these bytes."""
    return lambda file: file.write(data)


def write_all_new(directory: Path, files: Mapping[str, Writer]) -> list[Path]:
    """Make files by their names in a directory, which is made where it is missing: all of them or none.

    Raises FileError where one exists already or cannot be made, CellError when the disk refuses.
    """
    return _write_all(directory, files, over=False)


def write_all_over(directory: Path, files: Mapping[str, Writer]) -> list[Path]:
    """Make files as `write_all_new` does, in place of those that are there: each is the old or the new one, whole."""
    return _write_all(directory, files, over=True)


def write_views(directory: Path, files: Mapping[str, Writer]) -> list[Path]:
    """Make pictures by their names in a directory, in place of those that rig made before. Raises FileError for any
    other file that is there, and as `write_all_new` does."""
    for name in files:
        refuse_foreign(directory / name, "--plot")
    return _write_all(directory, files, over=True)


def _write_all(directory: Path, files: Mapping[str, Writer], *, over: bool) -> list[Path]:
    paths = [directory / name for name in files]
    for path in () if over else paths:
        refuse_existing(path)
    made, remedy = False, "give another --plot" if over else "give another --output"
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
    """Make a file by `write`, whole or not at all: until it is complete it has another name.

    Raises FileError where it exists already or cannot be made, CellError when the disk refuses.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise FileError(str(path.parent), "is a file, and a directory is needed", "give another --output") from None
    except OSError as error:
        raise FileError(str(path.parent), error.strerror or str(error), "give another --output") from None
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
            raise FileError(str(path), error.strerror or str(error), "give another --output") from None
        problem = f"cannot be written: {error.strerror or error}"
        raise CellError(str(path), problem, "free some space or choose another disk") from error
    finally:
        with suppress(OSError):
            surely(lambda: temporary.unlink(missing_ok=True))


def _hold_free(path: Path) -> None:
    if os.path.lexists(path):
        raise FileExistsError(path)


def _exists(path: Path) -> FileError:
    return FileError(str(path), "exists already", "give another --output, or remove it first")


def write_parquet(table: pa.Table, file: BinaryIO) -> None:
    """The table as Parquet, without the store's own notes."""
    import pyarrow.parquet as pq  # noqa: PLC0415 - slow to import, needed for Parquet only

    pq.write_table(table.replace_schema_metadata(None), file, compression="zstd")


def write_csv(table: pa.Table, file: BinaryIO) -> None:
    """The table as UTF-8 with a header and commas; every number in the fewest digits that give it back.

    Text is plain (`rigs.text`), line feeds in it stay; text that a spreadsheet takes for a formula has an apostrophe
    before it, as those programs themselves write it. Parquet keeps text as it was.
    """
    file.write((",".join(map(_quoted, table.column_names)) + "\n").encode())
    for batch in table.to_batches(max_chunksize=ROWS_AT_ONCE):
        columns = (column.to_pylist() for column in batch.columns)
        texts = [[_quoted(cell) if isinstance(cell, str) else repr(cell) for cell in column] for column in columns]
        file.writelines((",".join(row) + "\n").encode() for row in zip(*texts, strict=True))


def write_xlsx(table: pa.Table, file: BinaryIO) -> None:
    """The table as a workbook with one sheet, its header kept in sight; text is text, never a formula or a link.

    Raises FileError for more rows than a sheet has, and CellError where the library is missing.
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
    """What stands in a cell of a sheet; what is unknown leaves it empty."""
    if isinstance(value, str):
        from openpyxl.cell import WriteOnlyCell  # noqa: PLC0415

        cell = WriteOnlyCell(sheet, plain_lines(value))
        cell.data_type = "s"  # also where it begins as a formula
        return cell
    return value if value is not None and math.isfinite(value) else None


def _quoted(text: str) -> str:
    text = no_formula(plain_lines(text))
    if any(mark in text for mark in ',"\n'):
        return '"' + text.replace('"', '""') + '"'
    return text

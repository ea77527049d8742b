"""Tables in the format of an instrument, with cells as text.

The detected separators, decimals, comments, header and units become part of the map, where the operator can correct
them.
"""

from __future__ import annotations

import csv
import io
import re
import zipfile
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pa_csv

from analysis.intake.read import DECIMAL_COMMAS, refuse_other_formats, value
from analysis.intake.table_map import SEPARATORS, FileLayout, Separator
from analysis.intake.table_problems import Problems, TableProblem
from analysis.robot.kinematics.arm import Array, Integers
from analysis.runs.noise.readings import evenly
from analysis.runs.tables import LARGEST, SOCKET
from daq.store.chunk import array_of
from rigs.distribution import to_install
from rigs.errors import FileError

_WORKBOOK = b"PK\x03\x04"
_MOST_UNPACKED = 40_000_000
"""Maximum unpacked size of a workbook in bytes; the reader needs eight times as much memory."""
_MOST_SHEET_CELLS = 500_000
"""Maximum number of cells of a workbook, read in some ten seconds (measured)."""
_MOST_CELLS, _MOST_COLUMNS = 20_000_000, 1000
_SAMPLED = 100
"""Number of lines at the start and at the end used to detect the layout."""
_COMMENTS = ("#", "%", "//")
_NUMBER = r"^[ \t]*[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?[ \t]*$"
_POINT = re.compile(_NUMBER)
_COMMA = re.compile(r"[+-]?[0-9]+,[0-9]+([eE][+-]?[0-9]+)?")
_UNIT = re.compile(r"[\[(]?\s*(mm|m|cm|um|µm|in|inch|deg|°|rad|s|ms|-|degrees|radians|°c|)\s*[\])]?", re.IGNORECASE)
_MOSTLY = 0.6
"""Minimum share of numbers in a numeric column. The other cells are reported one by one."""
_FEWEST = 3
"""Minimum number of columns: a position has three."""


@dataclass(frozen=True)
class RawTable:
    where: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    """Text of a units line below the header, or ""."""
    cells: pa.Table
    """Text columns for `names`."""
    lines: Integers
    """Line numbers (n,) from 1."""
    decimal_comma: bool

    def numbers(self, names: Sequence[str], problems: Problems | None = None) -> Array:
        """Columns (n, k) as numbers. Bad cells are nan and added to `problems`, or raised as TableFileError."""
        bad_cells = Problems() if problems is None else problems
        columns = np.full((len(self.lines), len(names)), np.nan)
        for name, column in zip(names, columns.T, strict=True):
            if name not in self.names:
                remedy = f"name an existing column in the map: {', '.join(map(repr, self.names[:30]))}"
                raise FileError(self.where, f"has no column {name!r}", remedy, code="table.invalid")
            good = array_of(self._is_number(name)).astype(bool)
            plain = pc.utf8_trim_whitespace(self._plain(name))
            if good.any():
                column[good] = array_of(pc.filter(plain, pa.array(good)).cast(pa.float64()))
            large = good & ~(np.abs(column) <= LARGEST)
            for row in np.flatnonzero(~good | large).tolist():
                text = str(plain[row].as_py())
                why = f"{text!r} is not a number"
                try:
                    value("x_mm", text)
                except ValueError as error:
                    why = str(error)
                bad_cells.add([TableProblem(int(self.lines[row]), name, why)])
        if problems is None:
            bad_cells.refuse(self.where)
        return columns

    @property
    def socket_column(self) -> str | None:
        return next((name for name in self.names if name.strip().lower() == SOCKET), None)

    @cached_property
    def numeric(self) -> tuple[str, ...]:
        return tuple(name for name in self.names if array_of(self._is_number(name)).mean() >= _MOSTLY)

    def evenly(self, rows: int) -> RawTable:
        """At most `rows` evenly spaced rows whose numeric cells are all valid."""
        sound = np.ones(len(self.lines), dtype=bool)
        for name in self.numeric:
            sound &= array_of(self._is_number(name)).astype(bool)
        sound_rows = np.flatnonzero(sound)
        if not len(sound_rows):
            raise FileError(self.where, "has a bad cell in every row", "correct the file", code="table.invalid")
        chosen = sound_rows[evenly(len(sound_rows), rows)]
        return replace(self, cells=self.cells.take(chosen), lines=self.lines[chosen])

    def _plain(self, name: str) -> pa.ChunkedArray:
        cells = self.cells[name]
        return pc.replace_substring(cells, ",", ".") if self.decimal_comma else cells

    def _is_number(self, name: str) -> pa.ChunkedArray:
        return pc.match_substring_regex(self._plain(name), _NUMBER)


def is_workbook(data: bytes) -> bool:
    return data.startswith(_WORKBOOK)


def sheets_of(data: bytes, where: str) -> dict[str, bytes]:
    """Sheets of a workbook that have rows, each as comma-separated text."""
    try:
        import openpyxl  # noqa: PLC0415 - an extra, and slow to import
    except ModuleNotFoundError:
        problem = "is a workbook, and openpyxl is not installed"
        raise FileError(
            where, problem, f"{to_install('openpyxl')}, or save the sheet as CSV", code="package.missing"
        ) from None
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            if sum(member.file_size for member in archive.infolist()) > _MOST_UNPACKED:
                raise FileError(
                    where,
                    f"unpacks to more than {_MOST_UNPACKED / 1e6:g} MB",
                    "save the sheet as CSV",
                    code="file.too_large",
                )
        book = openpyxl.load_workbook(io.BytesIO(data), read_only=True, data_only=True)
        sheets = dict(_texts_within(book.worksheets, where))
    except FileError:
        raise
    except Exception as error:  # noqa: BLE001 - of a damaged workbook, whatever its readers raise
        problem = f"cannot be read as a workbook: {type(error).__name__}"
        raise FileError(where, problem, "save the sheet as CSV", code="table.invalid") from None
    return {name: text for name, text in sheets.items() if text.strip(b"\n,")}


def _texts_within(sheets: Iterable[Any], where: str) -> Iterator[tuple[str, bytes]]:
    count = 0
    for sheet in sheets:
        sheet.reset_dimensions()  # the stated size of a sheet may be too large or leave rows out
        rows = []
        for row in sheet.iter_rows(values_only=True):
            count += max(1, len(row))
            if count > _MOST_SHEET_CELLS:
                problem = f"has more than {_MOST_SHEET_CELLS} cells, in the sheet {sheet.title!r} at the latest"
                raise FileError(where, problem, "save the sheet with the table as CSV", code="file.too_large")
            texts = ["" if cell is None else re.sub(r"\s+", " ", str(cell)) for cell in row]
            # Replace the decimal comma, since commas separate the columns.
            rows.append([text.replace(",", ".") if _COMMA.fullmatch(text.strip()) else text for text in texts])
        width, written = max(map(len, rows), default=0), io.StringIO()
        writer = csv.writer(written, lineterminator="\n")
        for cells in rows:
            writer.writerow([*cells, *[""] * (width - len(cells))]) if any(cells) else written.write("\n")
        yield sheet.title, written.getvalue().encode()


def text_of(data: bytes, where: str, layout: FileLayout | None = None) -> tuple[list[str], FileLayout]:
    encoding = layout.encoding if layout else "utf-8"
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        encoding = "utf-16"
    else:
        refuse_other_formats(where, data)
    try:
        text = data.decode("utf-8-sig" if encoding == "utf-8" else encoding)
    except UnicodeDecodeError:
        if layout or encoding == "utf-16":
            raise FileError(
                where,
                f"is not {encoding}",
                "correct `encoding` in the map, or save the file as UTF-8",
                code="table.invalid",
            ) from None
        encoding, text = "cp1252", data.decode("cp1252", errors="replace")
    if "\0" in text:
        raise FileError(
            where,
            "contains zero bytes, so it is not a text file",
            "give the table as UTF-8 text",
            code="table.invalid",
        )
    return re.split(r"\r\n|\n|\r", text), FileLayout(encoding=encoding)


def layout_of(lines: Sequence[str], encoding: str, where: str) -> FileLayout:
    """Detect the layout of a table of numbers. Raises FileError for any other text."""
    comment = next((mark for line in lines[:1000] for mark in _COMMENTS if line.lstrip().startswith(mark)), "")
    rows = [k for k, line in enumerate(lines) if line.strip() and not (comment and line.lstrip().startswith(comment))]
    sampled = [*rows[:_SAMPLED], *rows[_SAMPLED:][-_SAMPLED:]]
    best: tuple[tuple[float, bool, float, int], Separator, bool, int] | None = None
    for name, mark in SEPARATORS.items():
        split = [_fields(lines[k], mark) for k in sampled]
        count = Counter(len(cells) for cells in split if len(cells) >= _FEWEST).most_common(1)
        if not count:
            continue
        fields = count[0][0]
        full_rows = [cells for cells in split if len(cells) == fields]
        for comma in (False, True) if mark != "," else (False,):
            share = float(np.mean([np.mean([_is_number(cell, comma) for cell in cells]) for cells in full_rows]))
            # A header with blanks in its names must not make blanks the separator.
            score = (round(len(full_rows) / len(split) * share, 3), mark != " ", share, fields)
            if best is None or score > best[0]:
                best = score, name, comma, fields
    if best is None or best[0][2] == 0:
        raise FileError(
            where, "lacks rows of numbers", "give a table: a row of numbers for each pose", code="table.invalid"
        )
    _, separator, comma, fields = best
    mark = SEPARATORS[separator]
    whole = [cells for k in sampled if len(cells := _fields(lines[k], mark)) == fields]
    tail = whole[len(whole) // 2 :]
    numeric = np.mean([[_is_number(cell, comma) for cell in cells] for cells in tail], axis=0) > 0.5
    data = (
        k
        for k in rows
        if len(cells := _fields(lines[k], mark)) == fields
        and np.mean([_is_number(cell, comma) for cell, number in zip(cells, numeric, strict=True) if number]) > 0.5
    )
    first = next(data, None)
    if first is None:
        raise FileError(
            where, "has non-numeric cells in every row", "give a table of measurements", code="table.invalid"
        )
    header, units = _header(lines, first, rows, comment, mark, fields)
    return FileLayout(
        encoding=encoding,
        separator=separator,
        decimal="comma" if comma else "point",
        comment=comment,
        header_line=header,
        units_line=units,
        first_line=first + 1,
    )


def _header(lines: Sequence[str], first: int, rows: list[int], comment: str, mark: str, fields: int) -> tuple[int, int]:
    """Line numbers from 1 of header, which may be a comment, and units before the first data row; 0 for none."""
    above = [k for k in rows if k < first][-2:]
    full = [k for k in above if len(_fields(lines[k], mark)) == fields]
    if full and all(_UNIT.fullmatch(cell.strip()) for cell in _fields(lines[full[-1]], mark)):
        return (full[-2] + 1 if len(full) > 1 else 0), full[-1] + 1
    if full and full[-1] == above[-1]:
        return full[-1] + 1, 0
    noted = [k for k in range(first) if comment and lines[k].lstrip().startswith(comment)]
    for k in noted[::-1][:1]:
        cells = _fields(lines[k].lstrip()[len(comment) :], mark)
        if len(cells) == fields and not any(_is_number(cell, True) for cell in cells):
            return k + 1, 0
    return 0, 0


def _fields(line: str, mark: str) -> list[str]:
    if mark == " ":
        return line.split()
    return [cell.strip().strip('"') for cell in line.split(mark)]


def _is_number(cell: str, comma: bool) -> bool:
    return bool(_POINT.match(cell.replace(",", ".", 1) if comma else cell))


def read_raw(lines: Sequence[str], layout: FileLayout, where: str) -> RawTable:
    mark = SEPARATORS[layout.separator]
    fields = len(_fields("".join(lines[layout.first_line - 1 : layout.first_line]), mark))

    def is_comment(line: str) -> bool:
        if not layout.comment or not line.startswith(layout.comment):
            return False
        first, *others = _fields(line, mark)  # ### marks a number too wide for its cell and is the first cell of a row
        return bool(first.strip(layout.comment)) or 1 + len(others) != fields

    kept = [
        k for k in range(layout.first_line - 1, len(lines)) if lines[k].strip() and not is_comment(lines[k].lstrip())
    ]
    if not kept:
        raise FileError(where, "has a header but no rows", "give the measured rows", code="table.invalid")
    body = [lines[k] for k in kept]
    if mark == " ":
        mark, body = "\t", ["\t".join(line.split()) for line in body]
    names, units = _names(lines, layout, body[0], mark)
    if len(names) > _MOST_COLUMNS or len(names) * len(body) > _MOST_CELLS:
        raise FileError(
            where,
            f"has more than {_MOST_CELLS} cells or {_MOST_COLUMNS} columns",
            "import the file in parts",
            code="file.too_large",
        )
    problems = Problems()

    def bad(row: pa_csv.InvalidRow) -> str:
        is_longer = (row.actual_columns or 0) > row.expected_columns
        why = DECIMAL_COMMAS if is_longer and mark == "," else "is the line cut off?"
        problem = f"has {row.actual_columns} fields, the table {row.expected_columns}; {why}"
        problems.add([TableProblem(kept[row.number - 1] + 1, "", problem)])
        return "skip"

    try:
        cells = pa_csv.read_csv(
            io.BytesIO("\n".join(body).encode()),
            pa_csv.ReadOptions(use_threads=False, column_names=names),
            pa_csv.ParseOptions(delimiter=mark, invalid_row_handler=bad),
            pa_csv.ConvertOptions(column_types={name: pa.string() for name in names}, strings_can_be_null=False),
        )
    except pa.ArrowInvalid as error:
        raise FileError(
            where, f"cannot be split into fields: {str(error)[:100]!r}", "check the quotes", code="table.unclear"
        ) from None
    problems.refuse(where)
    if cells.num_rows != len(kept):
        raise FileError(where, "has a cell of several lines", "put each row on one line", code="table.invalid")
    return RawTable(where, tuple(names), tuple(units), cells, np.array(kept) + 1, layout.decimal == "comma")


def _names(lines: Sequence[str], layout: FileLayout, body: str, mark: str) -> tuple[list[str], list[str]]:
    count = len(_fields(body, mark))

    def cells(number: int) -> list[str]:
        line = lines[number - 1] if 0 < number <= len(lines) else ""
        if layout.comment and line.lstrip().startswith(layout.comment):
            line = line.lstrip()[len(layout.comment) :]
        fields = line.split() if layout.separator == "blanks" else _fields(line, mark)
        return fields if len(fields) == count else [""] * count

    seen: Counter[str] = Counter()
    names = []
    for number, name in enumerate(cells(layout.header_line), start=1):
        unique = name or f"column {number}"
        seen[unique] += 1
        names.append(unique if seen[unique] == 1 else f"{unique} ({seen[unique]})")
    return names, cells(layout.units_line)


def joined(tables: Sequence[RawTable], join: str) -> tuple[RawTable, int]:
    """Join several files to a table, row by row (`rows`) or by a common column, and count the unmatched rows."""
    first, *others = tables
    if not others:
        return first, 0
    if len({table.decimal_comma for table in tables}) > 1:
        texts = [{name: pc.replace_substring(table.cells[name], ",", ".") for name in table.names} for table in tables]
        first, *others = (
            replace(table, cells=pa.table(cells), decimal_comma=False) if table.decimal_comma else table
            for table, cells in zip(tables, texts, strict=True)
        )
    left_out, units, lines = 0, list(first.units), first.lines
    places = []
    for table in others:
        if join == "rows":
            if len(table.lines) != len(lines):
                problem = f"has {len(table.lines)} rows, but {first.where} has {len(lines)}"
                raise FileError(
                    table.where, problem, "join the files by a common column: --join COLUMN", code="table.invalid"
                )
            places.append(np.arange(len(lines)))
            continue
        ours, theirs = (_index(side, join) for side in (first, table))
        places.append(np.array([theirs.get(key, -1) for key in ours], dtype=np.int64))
        left_out += len(ours.keys() ^ theirs.keys())
    keep = np.flatnonzero(np.all([at >= 0 for at in places], axis=0))
    columns = {name: first.cells[name].take(keep) for name in first.names}
    for number, (table, at) in enumerate(zip(others, places, strict=True), start=2):
        for name, unit in zip(table.names, table.units, strict=True):
            if name != join:
                columns[name if name not in columns else f"{name} (file {number})"] = table.cells[name].take(at[keep])
                units.append(unit)
    if not len(keep):
        problem = f"does not share a value of {join!r} with {first.where}"
        raise FileError(others[0].where, problem, "check the column of the join", code="table.invalid")
    where = f"{first.where} and {len(others)} more"
    return RawTable(where, tuple(columns), tuple(units), pa.table(columns), lines[keep], first.decimal_comma), left_out


def _index(table: RawTable, join: str) -> dict[str, int]:
    if join not in table.names:
        raise FileError(
            table.where,
            f"has no column {join!r} to join by",
            f"it has {', '.join(table.names[:20])}",
            code="table.invalid",
        )
    keys = [str(key).strip() for key in table.cells[join].to_pylist()]
    if len(set(keys)) < len(keys):
        problem = f"has a value of {join!r} twice"
        raise FileError(table.where, problem, "join by a column with unique values", code="table.invalid")
    return {key: row for row, key in enumerate(keys)}


def read_files(files: Sequence[tuple[Path, bytes]], layouts: Sequence[FileLayout], join: str) -> tuple[RawTable, int]:
    tables = []
    for (path, data), layout in zip(files, layouts, strict=True):
        if is_workbook(data):
            sheets = sheets_of(data, str(path))
            if layout.sheet not in sheets:
                problem = f"has no sheet {layout.sheet!r} with rows; it has {', '.join(map(repr, sheets)) or 'none'}"
                raise FileError(str(path), problem, "name a sheet as `sheet` in the map", code="table.invalid")
            data = sheets[layout.sheet]  # noqa: PLW2901 - the sheet stands for its workbook
        lines, _ = text_of(data, str(path), layout)
        tables.append(read_raw(lines, layout, str(path)))
    return joined(tables, join)

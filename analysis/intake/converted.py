"""Tables in Parquet, npz or JSON lines, and CSV files with lists in their cells, as CSV text for the other readers."""

from __future__ import annotations

import csv
import io
import json
import re
import zipfile
from collections.abc import Callable
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.json as pa_json
import pyarrow.parquet as pq

from rigs.errors import FileError

_MOST_CELLS, _MOST_UNPACKED = 20_000_000, 1_000_000_000
_LIST = re.compile(rb'"\[[^"\[\]]*\]"')
_COMMA_CELL = re.compile(rb'"[ \t]*([+-]?[0-9]+),([0-9]+)[ \t]*"')
_DIGITS_OF_THOUSANDS = 3
_POINT = re.compile(rb"[0-9]\.[0-9]")
_PLACE = ("x", "y", "z")
_PLACE_NAME = re.compile(r"pos(ition)?|xyz|place|point|translation|tvec", re.IGNORECASE)


def is_convertible(head: bytes) -> bool:
    """True if `csv_of` converts a file with these first bytes."""
    return any(is_of(head) for _, is_of, _ in _FORMATS) or _has_decimal_commas(head)


def csv_of(data: bytes, where: str) -> bytes:
    """CSV text of a table in another format; other data unchanged. Raises FileError for a damaged file."""
    for kind, is_of, read in _FORMATS:
        if not is_of(data):
            continue
        try:
            written = io.BytesIO()
            pa_csv.write_csv(_flat(read(data), where), written)
        except FileError:
            raise
        except Exception as error:  # noqa: BLE001 - the readers raise many kinds for a damaged file
            reason = str(error).partition("\n")[0][:100]
            problem = f"cannot be read as {kind}: {reason}"
            raise FileError(where, problem, "save the table as CSV", code="file.invalid") from None
        return written.getvalue()
    return _COMMA_CELL.sub(rb"\1.\2", data) if _has_decimal_commas(data) else data


def _is_parquet(data: bytes) -> bool:
    return data.startswith(b"PAR1")


def _is_npz(data: bytes) -> bool:
    length = int.from_bytes(data[26:28], "little")
    return data.startswith(b"PK\x03\x04") and data[30 : 30 + length].endswith(b".npy")


def _is_json_lines(data: bytes) -> bool:
    first, _, others = data.lstrip().partition(b"\n")
    if not first.startswith(b"{") or not others.lstrip().startswith(b"{"):
        return False
    try:
        return isinstance(json.loads(first), dict)
    except ValueError:
        return False


def _has_list_cells(data: bytes) -> bool:
    return bool(_LIST.search(data.partition(b"\n")[2].partition(b"\n")[0]))


def _has_decimal_commas(data: bytes) -> bool:
    """True if the first row has quoted decimals such as "37,5286", which are not thousands, and none with a point."""
    row = data.partition(b"\n")[2].partition(b"\n")[0]
    digits_behind = [len(behind) for _, behind in _COMMA_CELL.findall(row)]
    return any(count != _DIGITS_OF_THOUSANDS for count in digits_behind) and not _POINT.search(row)


def _read_parquet(data: bytes) -> pa.Table:
    return pq.read_table(io.BytesIO(data))


def _read_npz(data: bytes) -> pa.Table:
    """Table of the arrays with a row for each measurement; metadata of other lengths is left out."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        if sum(member.file_size for member in archive.infolist()) > _MOST_UNPACKED:
            raise ValueError(f"it unpacks to more than {_MOST_UNPACKED / 1e6:g} MB")
    with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
        by_name = {name: arrays[name] for name in arrays.files}
    rows = max((len(array) for array in by_name.values() if array.ndim), default=0)
    columns = {name: array for name, array in by_name.items() if array.ndim and len(array) == rows}
    return pa.table(
        {name: array.reshape(rows, -1).tolist() if array.ndim > 1 else array for name, array in columns.items()}
    )


def _read_json_lines(data: bytes) -> pa.Table:
    return pa_json.read_json(io.BytesIO(data))


def _read_list_cells(data: bytes) -> pa.Table:
    header, *rows = [row for row in csv.reader(io.StringIO(data.decode("utf-8-sig"))) if row]
    columns = zip(*rows, strict=True)
    values = [[_numbers(cell) for cell in cells] if all(map(_is_list, cells)) else list(cells) for cells in columns]
    return pa.table(values, names=header)


def _is_list(cell: str) -> bool:
    return cell.startswith("[") and cell.endswith("]")


def _numbers(cell: str) -> list[float]:
    return [float(part) for part in cell[1:-1].replace(",", " ").split()]


_FORMATS: tuple[tuple[str, Callable[[bytes], bool], Callable[[bytes], pa.Table]], ...] = (
    ("Parquet", _is_parquet, _read_parquet),
    ("npz", _is_npz, _read_npz),
    ("JSON lines", _is_json_lines, _read_json_lines),
    ("a table with lists in its cells", _has_list_cells, _read_list_cells),
)


def _flat(table: pa.Table, where: str) -> pa.Table:
    """Table with a column for each entry of a list and each field of a record."""
    while any(pa.types.is_struct(field.type) for field in table.schema):
        table = table.flatten()
    columns: dict[str, Any] = {}
    for name, column in zip(table.column_names, table.columns, strict=True):
        new = _columns_of(name, column, where)
        if twice := next(iter(columns.keys() & new.keys()), None):
            raise FileError(where, f"has two columns {twice!r}", "rename one of them", code="table.invalid")
        columns |= new
        if len(columns) * table.num_rows > _MOST_CELLS:
            problem = f"has more than {_MOST_CELLS} cells"
            raise FileError(where, problem, "import the file in parts", code="file.too_large")
    return pa.table(columns)


def _columns_of(name: str, column: pa.ChunkedArray, where: str) -> dict[str, Any]:
    kinds = (pa.types.is_list, pa.types.is_large_list, pa.types.is_fixed_size_list)
    if not any(is_kind(column.type) for is_kind in kinds):
        return {name: column}
    entries = column.to_pylist()
    counts = {len(entry or ()) for entry in entries}
    if len(counts) > 1:
        problem = f"has lists of {min(counts)} to {max(counts)} entries in {name!r}"
        raise FileError(where, problem, "write lists of the same length in each row", code="table.invalid")
    count = max(counts, default=0)
    is_place = count == len(_PLACE) and _PLACE_NAME.search(name)
    names = [f"{name}_{_PLACE[k] if is_place else k + 1}" for k in range(count)]
    return {one: [entry[k] for entry in entries] for k, one in enumerate(names)}

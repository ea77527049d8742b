"""Reading a table file: bytes to rows, rows to columns, every bad row named.

The file's own columns stay in their order; known ones become numbers, counts and words, extra ones stay
the text they are. Rows become columns of Arrow a batch at a time: as objects of Python, a table takes ten times the
memory, and where that ends, each of millions of small requests for more is refused by the system on its own.
"""

from __future__ import annotations

import csv
import hashlib
import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa

from analysis.files.bags import MCAP_MAGIC as MAGIC
from analysis.files.bags import is_bag
from analysis.files.cells import Columns, Problems, Row, TableFileError, TableProblem, column_type, columns_of
from analysis.files.header import check_header
from analysis.files.other_formats import refuse_comments, refuse_other_formats
from analysis.files.ros_bag import table_of_bag
from analysis.files.sequence import check_sequence
from analysis.files.write import as_it_was
from analysis.traces.table_layout import COMMANDED, JOINTS, LAYOUTS, JointSource, layout_of
from daq.store.schema import table_schema
from rigs.errors import FileError
from rigs.files import read_bytes
from rigs.rig import Rig
from rigs.schema.vocabulary import Direction, TestName

MOST_BYTES = 256_000_000
_MOST_CELLS, _MOST_COLUMNS = 20_000_000, 1000
"""The largest table, which takes some 0.5 GB while it is read; half an hour at 1 kHz with 9 columns has 16 million."""


@dataclass(frozen=True)
class TableFile:
    """A table as read. table: the file's columns, known ones as double, int64 or words, extra ones as text.

    direction: of a circle. sha256: of the file's bytes. doubts: what a bag leaves in doubt, in words.
    """

    path: Path
    sha256: str
    direction: Direction | None
    table: pa.Table
    doubts: tuple[str, ...] = ()


def read_file(
    path: Path, test: TestName, rig: Rig, direction: Direction | None = None, joints: JointSource = "measured"
) -> TableFile:
    """Read a table of docs/tables.md: a CSV file, or a bag of ROS 2 from which one is made.

    direction: of a circle whose table has no direction column; the column is then added after t_s. joints: which of two
    sets of columns are the robot's; the other is kept under a name that says what it is.
    Raises FileError for a file that cannot be read, TableFileError with every mistake in it.
    """
    data = read_whole(path)
    text, doubts = _table_of_bag(data, str(path), test, rig) if is_bag(data) else (data, ())
    table = parse_csv(text, str(path), test, rig, direction, joints)
    words = table["direction"][0].as_py() if "direction" in LAYOUTS[test].required else None
    return TableFile(path, hashlib.sha256(data).hexdigest(), words, table, doubts)


def parse_csv(
    data: bytes,
    where: str,
    test: TestName,
    rig: Rig,
    direction: Direction | None = None,
    joints: JointSource = "measured",
) -> pa.Table:
    """The table in the bytes of a file; `where` names it in errors. See `read_file`."""
    if direction and "direction" not in LAYOUTS[test].required:
        raise FileError(where, f"is of a {test} test, which has no direction", "leave --direction out")
    _require_text(where, data)
    rows = _rows(data, where)
    _, names = next(rows, (1, []))
    if names and names[0].startswith("#"):
        refuse_comments(where, data, test)
    if not any(names):
        raise FileError(where, "is empty", "give a table with a header line")
    if len(names) > _MOST_COLUMNS:
        raise FileError(where, f"has {len(names)} columns, more than {_MOST_COLUMNS}", "leave out those not needed")
    names = [as_it_was(name) for name in names]
    if joints == "commanded":
        names = _commanded(names, where)
    axes = len(rig.robot.axes)
    layout = layout_of(test, axes, rail=rig.robot.rail is not None)
    check_header(where, names, test, direction is not None, axes, layout)
    problems = Problems()
    columns, lines = columns_of(_whole_rows(rows, names, where, problems), names, layout, problems)
    if not len(lines) and not problems.count:
        raise FileError(where, "has a header and no rows", "give the measured rows")
    if direction and "direction" not in columns:
        columns = _with_direction(columns, direction, len(lines))
    problems.add(check_sequence(columns, lines, test, rig, direction))
    if problems.count:
        raise TableFileError(where, problems.first, count=problems.count)
    return pa.table(columns, schema=table_schema({name: column_type(name, layout) for name in columns}))


def _commanded(names: list[str], where: str) -> list[str]:
    """Column names with the commanded joints as the robot's, and those measured by a name that says so."""
    if missing := [name for name in COMMANDED if name not in names]:
        what = f"has no {', '.join(missing)}, which --joints commanded reads"
        raise FileError(where, what, "rename the columns of the commanded joints, or leave --joints out")
    measured = tuple(name.replace("_deg", "_measured_deg") for name in JOINTS)
    renamed = dict(zip((*COMMANDED, *JOINTS), (*JOINTS, *measured), strict=True))
    return [renamed.get(name, name) for name in names]


def read_whole(path: Path) -> bytes:
    """The bytes of a table file, bounded. Raises FileError for one that cannot be read or is too large."""
    try:
        return read_bytes(path, MOST_BYTES)
    except IsADirectoryError:
        raise FileError(str(path), "is a directory", "give a file; of a bag the .mcap or .db3 file in it") from None
    except OSError as error:
        raise FileError(str(path), error.strerror or str(error), "check the path and its permissions") from None
    except FileError:
        if path.is_file() and path.stat().st_size > MOST_BYTES and _begins_with(path, MAGIC):
            what = f"is a bag of more than {MOST_BYTES / 1e6:g} MB"
            remedy = "keep the topics that are read: mcap filter BAG -y /joint_states -y /g1 -y /g2 -o SMALL"
            raise FileError(str(path), what, remedy) from None
        raise


def _table_of_bag(data: bytes, where: str, test: TestName, rig: Rig) -> tuple[bytes, tuple[str, ...]]:
    if "direction" not in LAYOUTS[test].required:
        what = "is a bag, from which circles are read, and poses by a map"
        raise FileError(where, what, f"give the table of a {test} test as CSV")
    return table_of_bag(data, where, rig, test)


def _begins_with(path: Path, head: bytes) -> bool:
    with path.open("rb") as file:
        return file.read(len(head)) == head


def _require_text(where: str, data: bytes) -> None:
    refuse_other_formats(where, data)
    try:
        if not data.isascii():
            data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise FileError(where, f"line {line} is not UTF-8", "save it as UTF-8") from None
    if b"\0" in data:
        raise FileError(where, "contains zero bytes, which a text file cannot", "give the table as UTF-8 text")


def _rows(data: bytes, where: str) -> Iterator[Row]:
    """Rows that hold anything, in order. Raises TableFileError where quotes do not match."""
    reader = csv.reader(io.TextIOWrapper(io.BytesIO(data), encoding="utf-8-sig", newline=""), strict=True)
    begin = 1
    try:
        for fields in reader:
            if fields:
                yield begin, fields
            begin = reader.line_num + 1
    except csv.Error as error:
        problem = TableProblem(begin, "", f"cannot be split into fields: {error}; check its quotes")
        raise TableFileError(where, [problem]) from None


def _whole_rows(rows: Iterator[Row], names: list[str], where: str, problems: Problems) -> Iterator[Row]:
    """Rows with a field for each name; the others are problems. Raises FileError for more rows than a table has."""
    most_rows = _MOST_CELLS // len(names)
    count = 0
    for line, fields in rows:
        if len(fields) != len(names):
            what = f"has {len(fields)} fields, the header {len(names)}{_why(fields, names)}"
            problems.add([TableProblem(line, "", what)])
            continue
        if count > most_rows:
            what = f"has more than {_MOST_CELLS} cells, the first {line} lines alone"
            raise FileError(where, what, "import it in several runs")
        count += 1
        yield line, fields


def _why(fields: list[str], names: list[str]) -> str:
    if len(fields) > len(names):
        return "; put a text with a comma in quotes, and write decimals with a point"
    return "; is the line cut off?"


def _with_direction(columns: Columns, direction: Direction, rows: int) -> Columns:
    completed: dict[str, pa.ChunkedArray] = {}
    for name, values in columns.items():
        completed[name] = values
        if name == "t_s":
            completed["direction"] = pa.chunked_array([pa.repeat(direction, rows)])
    return completed

"""Tables in the format of docs/tables.md, with mistakes by row.

Rows become Arrow in batches: as Python objects, a table takes ten times the memory. Cells are parsed more strictly than
by float(), which accepts `1_000`, `nan` and digits of any script.
"""

from __future__ import annotations

import csv
import difflib
import hashlib
import io
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from analysis.intake.converted import csv_of
from analysis.intake.readers import reader_of
from analysis.intake.table_files import cut_off_doubts, read_whole
from analysis.intake.table_map import MAPPED, TO_UNIT
from analysis.intake.table_problems import Problems, TableFileError, TableProblem, quoted
from analysis.procedures.stops import target_count
from analysis.robot.description.ur_calibration import ROS_KINEMATICS
from analysis.robot.kinematics.arm import Array
from analysis.runs.tables import (
    COMMANDED,
    COUNTS,
    JOINTS,
    LARGEST,
    MEASURED,
    RAIL,
    SOCKET,
    TESTS,
    TIME_U,
    WORDS,
    JointSource,
    Layout,
    format_of,
    joint_columns,
)
from analysis.runs.written_files import as_it_was
from daq.store.chunk import ColumnType, table_schema
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.vocabulary import CIRCLES, DRIVEN_AXES, Direction, TestName, direction_of
from rigs.text import as_argument, enumerated, is_too_small

_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
_COUNT = re.compile(r"\+?[0-9]{1,9}(\.0*)?")
_OF_NUMBERS = re.compile(r"[0-9+\-.eE \t,]*")
"""Characters of plain numbers. For texts limited to these, float() and `value` agree on validity."""
Value = float | int | str
MOST_LETTERS = 40


def value(column: str, text: str) -> Value:
    """Cell of a known column. Raises ValueError with the reason in words."""
    text = text.strip(" \t")
    if not text:
        raise ValueError("is empty; fill in the value or remove the row")
    if column == SOCKET:
        if len(text) > MOST_LETTERS or not text.isprintable():
            raise ValueError(
                f"{quoted(text)} is not a name of a socket: at most {MOST_LETTERS} letters, digits and signs"
            )
        return text
    if column in WORDS:
        words, direction = WORDS[column], direction_of(text.lower())
        if text in words:
            return text
        near = [direction] if direction in words else difflib.get_close_matches(text.lower(), words, n=1)
        hint = f"; did you mean {near[0]}?" if near else ""
        raise ValueError(f"{quoted(text)} is not {enumerated(words, 'or')}{hint}")
    if column in COUNTS:
        if not _COUNT.fullmatch(text) or float(text) < 1:
            raise ValueError(f"{quoted(text)} is not a positive integer: 1, 2, 3, …")
        return int(float(text))
    if not _NUMBER.fullmatch(text):
        problem = "not a number"
        if re.fullmatch(r"[+-]?(nan|inf|infinity)(\(.*\))?", text, re.IGNORECASE):
            problem = "not a finite number"
        elif re.fullmatch(r"[+-]?[0-9]+,[0-9]+", text):
            problem = f"written with a decimal comma; write {text.replace(',', '.')}"
        raise ValueError(f"{quoted(text)} is {problem}")
    number = float(text)
    if is_too_small(text):
        raise ValueError(f"{quoted(text)} is too small for a number; write 0 if that is meant")
    if abs(number) > LARGEST:
        raise ValueError(f"{quoted(text)} is too large for a measured value; check the unit")
    return number


def numbers(texts: Sequence[str]) -> Array | None:
    """Values (n,) of plain numbers; None if `value` has to parse each cell."""
    if not _OF_NUMBERS.fullmatch(",".join(texts)):
        return None
    try:
        parsed = np.fromiter(map(float, texts), dtype=float, count=len(texts))
    except ValueError:
        return None
    vanish = any(is_too_small(texts[row].strip()) for row in np.flatnonzero(parsed == 0).tolist())
    return parsed if np.abs(parsed).max(initial=0.0) <= LARGEST and not vanish else None


_BATCH_CELLS = 100_000
"""Number of cells converted at a time; as Python objects they take some 6 MB."""
Row = tuple[int, list[str]]
"""Line number of a row, from 1, and the fields."""
Columns = Mapping[str, pa.ChunkedArray]
"""Columns by name, null for bad cells."""


def columns_of(rows: Iterator[Row], names: list[str], layout: Layout, problems: Problems) -> tuple[Columns, np.ndarray]:
    """Columns and line numbers (n,) of rows with a field for each name. Bad cells become problems."""
    parts: dict[str, list[pa.Array]] = {name: [] for name in names}
    lines: list[np.ndarray] = [np.empty(0, dtype=np.int64)]
    while batch := list(islice(rows, max(1, _BATCH_CELLS // len(names)))):
        lines.append(np.array([line for line, _ in batch]))
        for name, texts in zip(names, zip(*(fields for _, fields in batch), strict=True), strict=True):
            parts[name].append(pa.array(_values(name, texts, lines[-1], layout, problems), column_type(name, layout)))
    columns = {name: pa.chunked_array(arrays, column_type(name, layout)) for name, arrays in parts.items()}
    return columns, np.concatenate(lines)


def column_type(name: str, layout: Layout) -> ColumnType:
    if name not in layout.known_columns or name in WORDS or name == SOCKET:
        return "string"
    return "int64" if name in COUNTS else "double"


def _values(
    name: str, texts: Sequence[str], lines: np.ndarray, layout: Layout, problems: Problems
) -> Sequence[Value | None] | Array:
    if name not in layout.known_columns:
        return [as_it_was(text) for text in texts]
    if column_type(name, layout) == "double" and (parsed := numbers(texts)) is not None:
        return parsed
    cells, why = dict[str, Value | None](), dict[str, str]()
    for text in set(texts):
        try:
            cells[text] = value(name, text)
        except ValueError as error:
            cells[text], why[text] = None, str(error)
    rows = zip(lines.tolist(), texts, strict=True)
    problems.add(TableProblem(line, name, why[text]) for line, text in rows if text in why)
    return [cells[text] for text in texts]


DECIMAL_COMMAS = "put a text with a comma in quotes, and write decimals with a point"
"""Remedy for a row with more fields than the header."""
_SPEED_FACTOR = 2.0
"""Factor on the rated speed of a joint above which a step counts as a jump."""
_ROUNDING_DEG = 2.0
"""Minimum size of a jump: times are rounded, and speeds in rig files are nominal."""
_LARGEST_STEP_DEG = 120.0
"""Largest step of a joint between adjacent samples, at any sampling rate."""


def check_sequence(
    columns: Columns, lines: np.ndarray, test: TestName, rig: Rig, direction: Direction | None
) -> Iterator[TableProblem]:
    """Mistakes between rows, and conflicts with the rig. Null cells are skipped: they are reported already.

    lines: line numbers of the rows (n,).
    """
    columns_of_test = format_of(test).layout().known_columns
    if "t_s" in columns_of_test and "t_s" in columns:
        t_s = columns["t_s"].to_numpy()
        timed = np.flatnonzero(np.isfinite(t_s))
        for k in np.flatnonzero(np.diff(t_s[timed]) <= 0):
            fact = f"time does not increase: {t_s[timed[k + 1]]:g} after {t_s[timed[k]]:g}"
            yield TableProblem(int(lines[timed[k + 1]]), "t_s", fact)
    for name in (name for name in TIME_U if name in columns_of_test and name in columns):
        for k in np.flatnonzero(columns[name].to_numpy() < 0):
            yield TableProblem(int(lines[k]), name, "an uncertainty is not below zero")
    if "target" in columns_of_test and rig.tests.hemisphere:
        target = columns["target"].to_numpy()
        count = target_count(rig.tests.hemisphere)
        for k in np.flatnonzero(target > count):
            fact = f"{target[k]:.0f} is not one of the {count} targets of the rig's hemisphere"
            yield TableProblem(int(lines[k]), "target", fact)
    axes = len(rig.robot.axes)
    further = joint_columns(axes + 1)[-1]
    if further in columns:
        fact = f"the table has {axes + 1} joints, and the arm of the rig file {axes}"
        advice = "rename the column of a gripper" if axes < DRIVEN_AXES else "give the rig file of that arm"
        yield TableProblem(1, further, f"{fact}; {advice}")
    if SOCKET in columns_of_test:
        declared = rig.tests.touch.sockets if rig.tests.touch else ()
        for line, socket in zip(lines.tolist(), columns[SOCKET].to_pylist(), strict=True):
            if declared and socket is not None and socket not in declared:
                fact = f"{socket!r} is not a socket of the rig file: {', '.join(declared)}"
                yield TableProblem(int(line), SOCKET, fact)
    if "direction" in columns_of_test:
        yield from _check_circle(columns, lines, rig, direction)


def _check_circle(columns: Columns, lines: np.ndarray, rig: Rig, direction: Direction | None) -> Iterator[TableProblem]:
    words = columns["direction"]
    named = pc.unique(words.drop_null()).to_pylist()
    if direction and named == ["acw" if direction == "cw" else "cw"]:
        yield TableProblem(int(lines[0]), "direction", f"the table gives {named[0]}; leave --direction out")
    elif len(named) > 1:
        fact = f"{named[1]} after {named[0]}: a file may contain only one direction; split the file here"
        yield TableProblem(int(lines[pc.index(words, named[1]).as_py()]), "direction", fact)
    t_s = columns["t_s"].to_numpy()
    for axis, name in zip(rig.robot.axes, JOINTS, strict=True):
        q_deg = columns[name].to_numpy()
        finite = np.flatnonzero(np.isfinite(t_s) & np.isfinite(q_deg))
        step, gap_s = np.diff(q_deg[finite]), np.diff(t_s[finite])
        reachable = _SPEED_FACTOR * axis.speed_deg_s * np.maximum(gap_s, 0.0) + _ROUNDING_DEG
        jump = (np.abs(step) > np.minimum(reachable, _LARGEST_STEP_DEG)) & (gap_s > 0)
        came = -2
        for k in np.flatnonzero(jump).tolist():
            # A single bad row jumps there and back: report it, but not the good row after it.
            if came == k - 1 and step[k] * step[k - 1] < 0:
                came = -2
                continue
            came = k
            fact = f"jumps by {step[k]:.4g}° in {gap_s[k]:.3g} s"
            if abs(abs(step[k]) - 360) < 20:
                fact += ": a full turn is missing; unwrap the angle"
            yield TableProblem(int(lines[finite[k + 1]]), name, fact)


_CELL = r"[\s0-9.eE+-]*|" + "|".join(word for words in WORDS.values() for word in words)
"""A number or a reserved word: a first line of such cells means a missing header."""
_UNITS = {"deg": "degrees", "mm": "mm", "s": "seconds"}


def check_header(
    where: str, names: list[str], test: TestName, direction_given: bool, axes: int = 6, layout: Layout | None = None
) -> None:
    """Raise FileError for a wrong separator, TableFileError for wrong or missing columns.

    layout: default for an arm with `axes` axes without a rail. direction_given: the direction column may be missing.
    """
    line = ",".join(names) if len(names) <= 2 else ""
    if line.count(";") > 2:
        remedy = f"save the file with commas and decimal points: sed 'y/,;/.,/' {as_argument(where)} > TABLE.csv"
        raise FileError(where, "separates columns by semicolons", remedy, code="table.invalid")
    if line.count("\t") > 2:
        remedy = f"save the file with commas between columns: tr '\\t' ',' < {as_argument(where)} > TABLE.csv"
        raise FileError(where, "separates columns by tabs", remedy, code="table.invalid")
    layout = layout or format_of(test).layout(axes)
    problems = [
        TableProblem(1, name, "this column occurs twice; remove or rename one")
        for name, count in Counter(names).items()
        if count > 1
    ]
    missing = [name for name in layout.required if name not in names and not (direction_given and name == "direction")]
    if len(missing) == len(layout.required) and all(re.fullmatch(_CELL, name) for name in names):
        raise FileError(
            where, "lacks a header line", f"insert this first line: {','.join(layout.required)}", code="table.invalid"
        )
    problems += [TableProblem(1, name, _missing_column_problem(name, names, layout, test)) for name in missing]
    if not format_of(test).gauges and RAIL in names and RAIL not in layout.known_columns:
        fact = "the arm of the rig file has no rail; add robot.rail to the rig file, or rename this column"
        problems.append(TableProblem(1, RAIL, fact))
    for group in layout.together:
        stated = [name for name in group if name in names]
        if 0 < len(stated) < len(group):
            fact = f"has {' and '.join(stated)} only; give all of {', '.join(group)}, or none"
            problems.append(TableProblem(1, "", fact))
    if problems:
        mapped = "" if test == MAPPED else "; a map reads other names and units (--map)"
        raise TableFileError(where, problems, f"a {test} table needs {','.join(layout.required)}{mapped}")


def _missing_column_problem(name: str, names: list[str], layout: Layout, test: TestName) -> str:
    # Find an extra column that may be the missing one: with the same stem (g1_inch for g1_mm) or similar spelling.
    # Column names of other tests are not candidates.
    of_any = {column for test in TESTS for column in format_of(test).layout().known_columns}
    extras = [extra for extra in names if extra not in of_any]
    of_same_stem = [extra for extra in extras if _stem(extra) == _stem(name)]
    taken = {_stem(column) for column in layout.known_columns}
    alike = difflib.get_close_matches(name, [extra for extra in extras if _stem(extra) not in taken], n=1)
    near = next(iter(of_same_stem + alike), None)
    if near:
        stem, _, unit = name.rpartition("_")
        unit_hint = f", in {_UNITS[unit]}" if stem and unit in _UNITS and not near.endswith(unit) else ""
        factor = TO_UNIT.get(unit, {}).get(near.rpartition("_")[2].lower(), 1.0)
        unit_hint += f" (multiply the values by {factor:g})" * (factor != 1.0)
        return f"this column is missing; is {quoted(near)} meant? Then rename the column to {name}{unit_hint}"
    if name == "direction":
        return "this column is missing; add the column, or give --direction cw or acw"
    if test in CIRCLES and name == "g2_mm":
        return "this column is missing; an angle takes two gauges"
    return "this column is missing; add the column"


def _stem(name: str) -> str:
    return re.split(r"[\W_]", name.strip().lower())[0]


_BEGINNINGS = (
    (b"\xff\xfe", "is UTF-16", "save the file as UTF-8"),
    (b"\xfe\xff", "is UTF-16", "save the file as UTF-8"),
    (
        b"#ROSBAG",
        "is a bag of ROS 1",
        "convert the file to MCAP: rosbags-convert --src {file} --dst BAG --dst-storage mcap",
    ),
    (b"\x28\xb5\x2f\xfd", "is compressed (zstd)", "unpack the file first: zstd -d {file}"),
    (b"\x1f\x8b", "is compressed (gzip)", "unpack the file first: gunzip -k {file}"),
    (b"\x04\x22\x4d\x18", "is compressed (lz4)", "unpack the file first: lz4 -d {file}"),
    (b"PK\x03\x04", "is a workbook or a zip file", "save the table as CSV, or unpack the file first"),
    (b"\xd0\xcf\x11\xe0", "is a workbook of an old Excel", "save the table as CSV"),
    (b"%PDF", "is a PDF", "give the table as CSV"),
)
"""Signatures of unsupported files, with description and remedy."""


def refuse_other_formats(where: str, data: bytes) -> None:
    for magic, fact, remedy in _BEGINNINGS:
        if data.startswith(magic):
            raise FileError(where, fact, remedy.format(file=as_argument(where)), code="table.invalid")
    if data.lstrip().startswith(ROS_KINEMATICS.encode()):
        fact = "is the kinematics of an arm (ur_calibration of ROS), not a table of measurements"
        raise FileError(
            where,
            fact,
            "give it as --calibration FILE, and the table of measurements in its place",
            code="table.invalid",
        )
    if where.lower().endswith((".yaml", ".yml")):
        raise FileError(
            where,
            "is a YAML file, such as a rig file, not a table",
            "give the table of measurements",
            code="table.invalid",
        )


def refuse_comments(where: str, data: bytes, test: TestName) -> None:
    """Raise FileError for a table that starts with comment lines, the last of which may be the header."""
    lines = data.decode("utf-8-sig").splitlines()
    count = next((number for number, line in enumerate(lines) if not line.startswith("#")), len(lines))
    names = {name.strip() for name in lines[count - 1].lstrip("# ").split(",")}
    file = as_argument(where)
    if len(names & set(format_of(test).layout().required)) > 1:
        before = f"1,{count - 1}d; " if count > 1 else ""
        problem = f"has the header in line {count} after a #, which marks a comment"
        raise FileError(
            where, problem, f"remove the #: sed '{before}s/^# *//' {file} > TABLE.csv", code="table.invalid"
        )
    comment = "a line" if count == 1 else f"{count} lines"
    raise FileError(
        where,
        f"begins with {comment} of comment (#)",
        f"remove the comments: sed '/^#/d' {file} > TABLE.csv",
        code="table.invalid",
    )


_MOST_CELLS, _MOST_COLUMNS = 20_000_000, 1000
"""Maximum size of a table, which takes some 0.5 GB: half an hour at 1 kHz has 16 million cells."""


@dataclass(frozen=True)
class TableFile:
    sha256: str
    """Hash of the file."""
    direction: Direction | None
    table: pa.Table
    """Known columns as double, int64 or words, extra ones as text."""
    doubts: tuple[str, ...] = ()
    """Remarks on a bag, or on a file that may be cut off."""


def read_file(
    path: Path, test: TestName, rig: Rig, direction: Direction | None = None, joints: JointSource = "measured"
) -> TableFile:
    """Read a table in the format of docs/tables.md from a CSV file or a ROS 2 bag.

    direction: of a circle, added as a column after t_s if the table lacks it. joints: the joint columns to use; the
    others are renamed. Raises FileError for an unreadable file, TableFileError for mistakes in it.
    """
    data = read_whole(path)
    has_direction = "direction" in format_of(test).layout().required
    if reader := reader_of(data):
        if not has_direction:
            problem = "is a bag, from which circles are read, and poses by a map"
            raise FileError(str(path), problem, f"give the table of a {test} test as CSV", code="table.invalid")
        text, doubts = reader.table_of(data, str(path), rig, test)
    else:
        text = csv_of(data, str(path))
        doubts = cut_off_doubts(text)
    table = parse_csv(text, str(path), test, rig, direction, joints)
    words = table["direction"][0].as_py() if has_direction else None
    return TableFile(hashlib.sha256(data).hexdigest(), words, table, doubts)


def parse_csv(
    data: bytes,
    where: str,
    test: TestName,
    rig: Rig,
    direction: Direction | None = None,
    joints: JointSource = "measured",
) -> pa.Table:
    if direction and "direction" not in format_of(test).layout().required:
        raise FileError(
            where,
            f"is of a {test} test, which does not have a direction",
            "leave --direction out",
            code="usage",
        )
    _require_text(where, data)
    rows = _csv_rows(data, where)
    _, header = next(rows, (1, []))
    if header and header[0].startswith("#"):
        refuse_comments(where, data, test)
    names = _names(header, where, joints)
    axes = len(rig.robot.axes)
    layout = format_of(test).layout(axes, rail=rig.robot.rail is not None)
    check_header(where, names, test, direction is not None, axes, layout)
    problems = Problems()
    columns, lines = columns_of(_whole_rows(rows, names, where, problems), names, layout, problems)
    if not len(lines) and not problems.count:
        raise FileError(where, "has a header but no rows", "give the measured rows", code="table.invalid")
    if direction and "direction" not in columns:
        added = pa.chunked_array([pa.repeat(direction, len(lines))])
        order = [key for name in columns for key in ((name, "direction") if name == "t_s" else (name,))]
        columns = {name: columns.get(name, added) for name in order}
    problems.add(check_sequence(columns, lines, test, rig, direction))
    problems.refuse(where)
    return pa.table(columns, schema=table_schema({name: column_type(name, layout) for name in columns}))


def _names(header: list[str], where: str, joints: JointSource) -> list[str]:
    if not any(header):
        raise FileError(where, "is empty", "give a table with a header line", code="table.invalid")
    if len(header) > _MOST_COLUMNS:
        raise FileError(
            where,
            f"has {len(header)} columns, more than {_MOST_COLUMNS}",
            "remove the columns that are not needed",
            code="file.too_large",
        )
    names = [as_it_was(name) for name in header]
    if joints != "commanded":
        return names
    # Use the commanded joints as those of the robot, and rename the measured joints.
    if missing := [name for name in COMMANDED if name not in names]:
        problem = f"has no {', '.join(missing)}, which --joints commanded reads"
        raise FileError(
            where,
            problem,
            "rename the columns of the commanded joints, or leave --joints out",
            code="table.invalid",
        )
    renamed = dict(zip((*COMMANDED, *JOINTS), (*JOINTS, *MEASURED), strict=True))
    return [renamed.get(name, name) for name in names]


def _require_text(where: str, data: bytes) -> None:
    refuse_other_formats(where, data)
    try:
        if not data.isascii():
            data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise FileError(where, f"line {line} is not UTF-8", "save the file as UTF-8", code="file.invalid") from None
    if b"\0" in data:
        raise FileError(
            where,
            "contains zero bytes, so it is not a text file",
            "give the table as UTF-8 text",
            code="table.invalid",
        )


def _csv_rows(data: bytes, where: str) -> Iterator[Row]:
    reader = csv.reader(io.TextIOWrapper(io.BytesIO(data), encoding="utf-8-sig", newline=""), strict=True)
    begin = 1
    try:
        for fields in reader:
            if fields:
                yield begin, fields
            begin = reader.line_num + 1
    except csv.Error as error:
        problem = TableProblem(begin, "", f"cannot be split into fields: {error}; check the quotes")
        raise TableFileError(where, [problem]) from None


def _whole_rows(rows: Iterator[Row], names: list[str], where: str, problems: Problems) -> Iterator[Row]:
    count = 0
    for line, fields in rows:
        if len(fields) != len(names):
            why = DECIMAL_COMMAS if len(fields) > len(names) else "is the line cut off?"
            problem = f"has {len(fields)} fields, the header {len(names)}; {why}"
            problems.add([TableProblem(line, "", problem)])
            continue
        if count > _MOST_CELLS // len(names):
            problem = f"has more than {_MOST_CELLS} cells in its first {line} lines"
            raise FileError(where, problem, "import the file in several runs", code="file.too_large")
        count += 1
        yield line, fields

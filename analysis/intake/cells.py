"""The cells of a table: the value of each, or why it has none, by its line and column; and its rows as columns of
numbers, counts and words, a batch at a time, every bad cell named.

Python's own float() takes `1_000`, `nan` and digits of any script; a table of measurements does not. The first twenty
mistakes are reported.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice

import numpy as np
import pyarrow as pa

from analysis.robot.kinematics.arm import Array
from analysis.runs.csv_tables import LARGEST
from analysis.runs.table_layout import COUNTS, SOCKET, WORDS, Layout
from analysis.runs.written_files import as_it_was
from daq.store.chunk import ColumnType
from rigs.errors import FileError
from rigs.schema.vocabulary import direction_of
from rigs.text import counted

_SHOWN = 20


@dataclass(frozen=True, order=True)
class TableProblem:
    """One mistake in a table: the line of the file, counted from 1, the column or "" for the whole row, the reason."""

    line: int
    column: str
    message: str

    def __str__(self) -> str:
        if not self.column:
            return f"line {self.line}: {self.message}"
        column = self.column if self.column.isprintable() else quoted(self.column)
        return f"line {self.line}, {column}: {self.message}"


@dataclass
class Problems:
    """The mistakes found so far: how many, and the first of them in order of lines; a bad file may have millions."""

    count: int = 0
    _kept: list[TableProblem] = field(default_factory=list)

    def add(self, problems: Iterable[TableProblem]) -> None:
        """Count problems, and keep those that may be among the first."""
        for problem in problems:
            self.count += 1
            self._kept.append(problem)
            if len(self._kept) > 50 * _SHOWN:
                self._kept = self.first

    @property
    def first(self) -> list[TableProblem]:
        """The problems that are shown, in order."""
        return sorted(self._kept)[:_SHOWN]


class TableFileError(FileError):
    """A table with mistakes; the first of them in `problems`, in order of lines."""

    def __init__(
        self, path: str, problems: list[TableProblem], remedy: str = "correct the file", count: int | None = None
    ) -> None:
        """count: of all mistakes, where problems are the first of them only."""
        total = len(problems) if count is None else count
        self.problems = sorted(problems)[:_SHOWN]
        shown = [str(problem) for problem in self.problems]
        if total > _SHOWN:
            shown.append(f"… and {total - _SHOWN} more, {total} mistakes in all")
        mistakes = counted(total, "mistake")
        super().__init__(path, f"{mistakes}: " + " | ".join(shown), remedy)
        self.shown = shown

    def lines(self) -> list[str]:
        return [
            *(f"{self.where}, {line}" for line in self.shown[:-1]),
            f"{self.where}, {self.shown[-1]}; {self.remedy}",
        ]


def quoted(text: str) -> str:
    """What stands in a file, fit for one line of a message."""
    return repr(text if len(text) <= 40 else text[:37] + "…")


_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
_COUNT = re.compile(r"\+?[0-9]{1,9}(\.0*)?")
_OF_NUMBERS = re.compile(r"[0-9+\-.eE \t,]*")
"""Where a text has no other characters, float() and `value` agree on whether it is a number."""
Value = float | int | str
MOST_LETTERS = 40


def value(column: str, text: str) -> Value:
    """The value of a cell of a known column. Raises ValueError with the reason in words."""
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
        words = WORDS[column]
        if text in words:
            return text
        lower = text.lower()
        direction = direction_of(lower)
        near = [direction] if direction in words else difflib.get_close_matches(lower, words, n=1)
        hint = f"; did you mean {near[0]}?" if near else ""
        raise ValueError(f"{quoted(text)} is not {', '.join(words[:-1])} or {words[-1]}{hint}")
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
    if abs(number) > LARGEST:
        raise ValueError(f"{quoted(text)} is too large for a measured value; check the unit")
    return number


def numbers(texts: Sequence[str]) -> Array | None:
    """The values (n,) of cells of a column of numbers; None where `value` has to look at them one by one."""
    if not _OF_NUMBERS.fullmatch(",".join(texts)):
        return None
    try:
        parsed = np.fromiter(map(float, texts), dtype=float, count=len(texts))
    except ValueError:
        return None
    return parsed if np.abs(parsed).max(initial=0.0) <= LARGEST else None


_BATCH_CELLS = 100_000
"""Cells that are objects of Python at a time: some 6 MB."""
Row = tuple[int, list[str]]
"""Line on which a row begins, counted from 1, and its fields."""
Columns = Mapping[str, pa.ChunkedArray]
"""Columns by name, null where a cell is bad."""


def columns_of(rows: Iterator[Row], names: list[str], layout: Layout, problems: Problems) -> tuple[Columns, np.ndarray]:
    """Columns of rows that have a field for each name, and the number of each row's line (n,); bad cells become
    problems."""
    parts: dict[str, list[pa.Array]] = {name: [] for name in names}
    lines: list[np.ndarray] = [np.empty(0, dtype=np.int64)]
    while batch := list(islice(rows, max(1, _BATCH_CELLS // len(names)))):
        lines.append(np.array([line for line, _ in batch]))
        for name, texts in zip(names, zip(*(fields for _, fields in batch), strict=True), strict=True):
            parts[name].append(pa.array(_values(name, texts, lines[-1], layout, problems), column_type(name, layout)))
    columns = {name: pa.chunked_array(arrays, column_type(name, layout)) for name, arrays in parts.items()}
    return columns, np.concatenate(lines)


def column_type(name: str, layout: Layout) -> ColumnType:
    """The type of a column in a table of a layout."""
    if name not in layout.known or name in WORDS or name == SOCKET:
        return "string"
    return "int64" if name in COUNTS else "double"


def _values(
    name: str, texts: Sequence[str], lines: np.ndarray, layout: Layout, problems: Problems
) -> Sequence[Value | None] | Array:
    if name not in layout.known:
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

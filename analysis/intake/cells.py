"""Cells of a table: validated values with error messages by line and column, and batched conversion of rows to typed
columns.

The parser is stricter than float() of Python, which accepts `1_000`, `nan` and digits of any script. The first twenty
mistakes are reported.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice

import numpy as np
import pyarrow as pa

from analysis.robot.kinematics.arm import Array
from analysis.runs.table_format import LARGEST
from analysis.runs.table_layout import COUNTS, SOCKET, WORDS, Layout
from analysis.runs.written_files import as_it_was
from daq.store.chunk import ColumnType
from rigs.errors import FileError
from rigs.schema.vocabulary import direction_of
from rigs.text import counted, enumerated, first_of

_SHOWN, _LINES = 20, 6
"""Largest number of mistakes shown, and of other lines with the same mistake."""


@dataclass(frozen=True, order=True)
class TableProblem:
    """A mistake in a table: line number from 1, column or "" for the complete row, reason, number of rows that have
    it, and the first other lines.
    """

    line: int
    column: str
    message: str
    rows: int = 1
    also: tuple[int, ...] = ()

    def __str__(self) -> str:
        others = f"{first_of(self.also, _LINES)}{f' and {self.rows - 1 - _LINES} more' * (self.rows - 1 > _LINES)}"
        message = f"{self.message} (also in line {others})" if self.also else self.message
        if not self.column:
            return f"line {self.line}: {message}"
        column = self.column if self.column.isprintable() else quoted(self.column)
        return f"line {self.line}, {column}: {message}"


def _without_repeats(problems: Iterable[TableProblem]) -> list[TableProblem]:
    """Problems in order, each column and message once, at its first line."""
    together: dict[tuple[str, str], TableProblem] = {}
    for problem in sorted(problems):
        first = together.setdefault((problem.column, problem.message), problem)
        if first is not problem:
            also = (*first.also, problem.line, *problem.also)[:_LINES]
            together[problem.column, problem.message] = replace(first, rows=first.rows + problem.rows, also=also)
    return list(together.values())


@dataclass
class Problems:
    """Count of the mistakes found, and the first ones by line; a bad file may have millions."""

    count: int = 0
    _kept: list[TableProblem] = field(default_factory=list)

    def add(self, problems: Iterable[TableProblem]) -> None:
        for problem in problems:
            self.count += 1
            self._kept.append(problem)
            if len(self._kept) > 50 * _SHOWN:
                self._kept = self.first

    @property
    def first(self) -> list[TableProblem]:
        return _without_repeats(self._kept)[:_SHOWN]


class TableFileError(FileError):
    """A table with mistakes; `problems` contains the first ones by line."""

    def __init__(
        self, path: str, problems: list[TableProblem], remedy: str = "correct the file", count: int | None = None
    ) -> None:
        """Create the error. count: number of all mistakes, if problems is a part of it."""
        total = sum(problem.rows for problem in problems) if count is None else count
        self.problems = _without_repeats(problems)[:_SHOWN]
        shown = [str(problem) for problem in self.problems]
        unlisted = total - sum(problem.rows for problem in self.problems)
        if unlisted > 0:
            shown.append(f"… and {unlisted} more, {total} mistakes in all")
        mistakes = counted(total, "mistake")
        super().__init__(path, f"{mistakes}: " + " | ".join(shown), remedy, code="table.value")
        self.shown = shown

    def lines(self) -> list[str]:
        return [
            *(f"{self.where}, {line}" for line in self.shown[:-1]),
            f"{self.where}, {self.shown[-1]}; {self.remedy}",
        ]


def quoted(text: str) -> str:
    """Text of a file, shortened and escaped for a message."""
    return repr(text if len(text) <= 40 else text[:37] + "…")


_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
_COUNT = re.compile(r"\+?[0-9]{1,9}(\.0*)?")
_OF_NUMBERS = re.compile(r"[0-9+\-.eE \t,]*")
"""Characters of plain numbers. For texts limited to these, float() and `value` agree on validity."""
Value = float | int | str
MOST_LETTERS = 40


def value(column: str, text: str) -> Value:
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
    if abs(number) > LARGEST:
        raise ValueError(f"{quoted(text)} is too large for a measured value; check the unit")
    return number


def numbers(texts: Sequence[str]) -> Array | None:
    """Parse the cells of a numeric column to values (n,); None if `value` has to parse each cell."""
    if not _OF_NUMBERS.fullmatch(",".join(texts)):
        return None
    try:
        parsed = np.fromiter(map(float, texts), dtype=float, count=len(texts))
    except ValueError:
        return None
    return parsed if np.abs(parsed).max(initial=0.0) <= LARGEST else None


_BATCH_CELLS = 100_000
"""Number of cells converted at a time; as Python objects they take some 6 MB."""
Row = tuple[int, list[str]]
"""Line number of a row, from 1, and the fields."""
Columns = Mapping[str, pa.ChunkedArray]
"""Columns by name, null for bad cells."""


def columns_of(rows: Iterator[Row], names: list[str], layout: Layout, problems: Problems) -> tuple[Columns, np.ndarray]:
    """Convert rows with a field for each name to columns, and return also the line numbers (n,). Bad cells become
    problems.
    """
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

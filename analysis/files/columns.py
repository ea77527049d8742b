"""The rows of a table as columns of numbers, counts and words, a batch of rows at a time, every bad cell named."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import islice

import numpy as np
import pyarrow as pa

from analysis.files.cells import Value, numbers, value
from analysis.files.formulas import as_it_was
from analysis.files.table_problems import Problems, TableProblem
from analysis.kinematics.arm import Array
from analysis.traces.table_layout import COUNTS, SOCKET, WORDS, Layout
from daq.store.schema import ColumnType

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
    if column_type(name, layout) == "double" and (found := numbers(texts)) is not None:
        return found
    read = {text: _read(name, text) for text in set(texts)}
    for line, text in zip(lines.tolist(), texts, strict=True):
        if isinstance(bad := read[text], ValueError):
            problems.add([TableProblem(line, name, str(bad))])
    return [None if isinstance(one := read[text], ValueError) else one for text in texts]


def _read(name: str, text: str) -> Value | ValueError:
    try:
        return value(name, text)
    except ValueError as error:
        return error

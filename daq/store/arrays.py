"""Columns of Arrow as arrays of numpy, without pandas: pyarrow's own way imports it wherever it is installed, which is
half of the time that a small run takes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa


def array_of(column: pa.ChunkedArray) -> np.ndarray[Any, Any]:
    """A column as one array (n,), in the unit of its name; it is not to be written to."""
    pieces = [piece_of(chunk) for chunk in column.chunks]
    if len(pieces) == 1:
        return pieces[0]
    return np.concatenate(pieces) if pieces else column.to_numpy()


def piece_of(chunk: pa.Array) -> np.ndarray[Any, Any]:
    """A chunk of a column as an array (n,), in its unit; numbers without a copy."""
    is_plain = chunk.null_count == 0 and (pa.types.is_integer(chunk.type) or pa.types.is_floating(chunk.type))
    plain: np.ndarray[Any, Any] = np.from_dlpack(chunk) if is_plain and len(chunk) else chunk.to_numpy(False)
    return plain

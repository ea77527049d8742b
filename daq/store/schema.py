"""What is stored: the columns of a stream, and how samples and faults become a batch of them.

Two shapes only: a sample stream (stamps, then the values in file units) and the one `faults` stream.
An imported run has a table instead of sample streams, with the columns that its file had.
No cell is ever null: nan and `NO_TIME` say "not there", so every column is a plain array everywhere.
`sequence` numbers the rows of a stream through all its chunks; a gap in it is a loss that shows.

The checksum covers names, types and every bit of every value, and not Arrow's encoding of them: the
same number must come out of the recording chunk and of the Parquet file made from it.

Columns of Arrow as arrays of numpy, without pandas: pyarrow's own way imports it wherever it is installed, which is
half of the time that a small run takes.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping, Sequence
from typing import Any, Literal, TypeAlias

import numpy as np
import pyarrow as pa

from daq.protocol.conversation import Fault, Sample, Samples

Array: TypeAlias = "pa.Array[Any]"
FAULTS = "faults"
"""The stream every run has; its rows name the stream they happened on."""
TABLE = "table"
"""The stream of an imported run."""
ColumnType = Literal["double", "int64", "string"]
"""Types of an imported table's columns, by Arrow's names."""
Row = Sample | tuple[str, Fault]
"""What is appended: a sample, or the stream's name with its fault."""

SAMPLE_COLUMNS: dict[str, pa.DataType] = {
    "requested_ns": pa.int64(),
    "first_byte_ns": pa.int64(),
    "last_byte_ns": pa.int64(),
    "size": pa.int32(),
    "device_time_s": pa.float64(),
    "status": pa.int32(),
    "sequence": pa.int64(),
}
FAULT_COLUMNS: dict[str, pa.DataType] = {
    "at_ns": pa.int64(),
    "stream": pa.string(),
    "kind": pa.string(),
    "detail": pa.string(),
    "count": pa.int64(),
    "sequence": pa.int64(),
}


def schema_of(stream: str, columns: Sequence[str]) -> pa.Schema:
    """Return the Arrow schema of a stream with these value columns (`faults` has none)."""
    fixed = FAULT_COLUMNS if stream == FAULTS else SAMPLE_COLUMNS
    types = {**fixed, **dict.fromkeys(columns, pa.float64())}
    return pa.schema([pa.field(name, kind, nullable=False) for name, kind in types.items()])


def table_schema(columns: Mapping[str, ColumnType]) -> pa.Schema:
    """Return the Arrow schema of an imported table."""
    kinds: dict[str, pa.DataType] = {"double": pa.float64(), "int64": pa.int64(), "string": pa.string()}
    return pa.schema([pa.field(name, kinds[kind], nullable=False) for name, kind in columns.items()])


def batch_of(rows: Sequence[Row], schema: pa.Schema, first: int) -> pa.RecordBatch:
    """Return rows of one stream as a batch whose `sequence` starts at `first`."""
    faults = [] if isinstance(rows, Samples) else [row for row in rows if not isinstance(row, Sample)]
    arrays = _fault_arrays(faults) if faults else _sample_arrays(Samples.of(rows))  # type: ignore[arg-type] # no faults
    sequence = np.arange(first, first + len(rows), dtype=np.int64)
    place = schema.get_field_index("sequence")
    return pa.record_batch([*arrays[:place], pa.array(sequence), *arrays[place:]], schema=schema)


def _sample_arrays(samples: Samples) -> list[Array]:
    # A device's unsigned 32-bit status wraps and keeps its bits: an odd code must not end a recording.
    kinds = {name: kind.to_pandas_dtype() for name, kind in SAMPLE_COLUMNS.items() if name != "sequence"}
    fixed = [pa.array(getattr(samples, name).astype(kind)) for name, kind in kinds.items()]
    return [*fixed, *(pa.array(np.ascontiguousarray(column)) for column in samples.values.T)]


def _fault_arrays(faults: Sequence[tuple[str, Fault]]) -> list[Array]:
    at_ns = pa.array([fault.at_ns for _, fault in faults], pa.int64())
    words = [(stream, str(fault.kind), storable(fault.detail)) for stream, fault in faults]
    count = pa.array([fault.count for _, fault in faults], pa.int64())
    return [at_ns, *(pa.array(list(column), pa.string()) for column in zip(*words, strict=True)), count]


def storable(text: str) -> str:
    """A text as UTF-8 can hold it: what a device or a terminal of another encoding sent may have a lone surrogate."""
    return text.encode("utf-8", "backslashreplace").decode()


def checksum(batch: pa.RecordBatch, number: int) -> int:
    """Return the CRC-32 over a batch and its number in the file.

    Raises ArrowInvalid when a column holds nulls.
    """
    head = f"{number} {batch.num_rows} {[(f.name, str(f.type)) for f in batch.schema]}"
    crc = zlib.crc32(head.encode())
    for column in batch.columns:
        crc = zlib.crc32(_canonical(column), crc)
    return crc


def _canonical(column: Array) -> Any:
    if pa.types.is_string(column.type):
        return json.dumps(column.to_pylist()).encode()
    return column.to_numpy(zero_copy_only=True)


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

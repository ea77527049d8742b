"""Encoding of a chunk: an Arrow IPC stream during recording, Parquet afterwards.

An Arrow stream has no checksum, and zeros at a batch boundary are read as a valid end. Each batch therefore contains a
number and a CRC-32, and all data after the last verified batch, except the exact end mark, is damage. The schema of
each file contains the opening manifest: any surviving chunk identifies the run, rig and clock. Cells are never null,
and `sequence` numbers the rows of a stream across all chunks, so that lost rows are visible as a gap.
"""

from __future__ import annotations

import errno
import json
import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from daq.protocol.conversation import Fault, Sample, SampleBlock

Array: TypeAlias = "pa.Array[Any]"
FAULTS = "faults"
"""Stream of faults in every run. Each row names the affected stream."""
TABLE = "table"
ColumnType = Literal["double", "int64", "string"]
"""Column types of imported tables, in Arrow's notation."""
Row = Sample | tuple[str, Fault]

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
    fixed = FAULT_COLUMNS if stream == FAULTS else SAMPLE_COLUMNS
    types = {**fixed, **dict.fromkeys(columns, pa.float64())}
    return pa.schema([pa.field(name, kind, nullable=False) for name, kind in types.items()])


def table_schema(columns: Mapping[str, ColumnType]) -> pa.Schema:
    kinds: dict[str, pa.DataType] = {"double": pa.float64(), "int64": pa.int64(), "string": pa.string()}
    return pa.schema([pa.field(name, kinds[kind], nullable=False) for name, kind in columns.items()])


def batch_of(rows: Sequence[Row], schema: pa.Schema, first: int) -> pa.RecordBatch:
    faults = [] if isinstance(rows, SampleBlock) else [row for row in rows if not isinstance(row, Sample)]
    if faults:
        at_ns = pa.array([fault.at_ns for _, fault in faults], pa.int64())
        words = [(stream, str(fault.kind), storable(fault.detail)) for stream, fault in faults]
        count = pa.array([fault.count for _, fault in faults], pa.int64())
        arrays = [at_ns, *(pa.array(list(column), pa.string()) for column in zip(*words, strict=True)), count]
    else:
        samples = SampleBlock.of(rows)  # type: ignore[arg-type] # no faults
        # An unsigned 32-bit status wraps but preserves its bits, because an unexpected code must not end a recording.
        kinds = {name: kind.to_pandas_dtype() for name, kind in SAMPLE_COLUMNS.items() if name != "sequence"}
        fixed = [pa.array(getattr(samples, name).astype(kind)) for name, kind in kinds.items()]
        arrays = [*fixed, *(pa.array(np.ascontiguousarray(column)) for column in samples.values.T)]
    sequence = np.arange(first, first + len(rows), dtype=np.int64)
    place = schema.get_field_index("sequence")
    return pa.record_batch([*arrays[:place], pa.array(sequence), *arrays[place:]], schema=schema)


def storable(text: str) -> str:
    """Text that is valid in UTF-8. Devices and terminals may send lone surrogates."""
    return text.encode("utf-8", "backslashreplace").decode()


def checksum(batch: pa.RecordBatch, number: int) -> int:
    """CRC-32 of a batch and its number in the file: names, types and all bits of the values.

    The Arrow encoding is not covered, because recording chunk and Parquet file must have equal checksums.
    """
    head = f"{number} {batch.num_rows} {[(f.name, str(f.type)) for f in batch.schema]}"
    crc = zlib.crc32(head.encode())
    for column in batch.columns:
        if pa.types.is_string(column.type):
            crc = zlib.crc32(json.dumps(column.to_pylist()).encode(), crc)
        else:
            crc = zlib.crc32(column.to_numpy(zero_copy_only=True), crc)
    return crc


def array_of(column: pa.ChunkedArray) -> np.ndarray[Any, Any]:
    pieces = [piece_of(chunk) for chunk in column.chunks]
    if len(pieces) == 1:
        return pieces[0]
    return np.concatenate(pieces) if pieces else column.to_numpy()


def piece_of(chunk: pa.Array) -> np.ndarray[Any, Any]:
    """A piece of a column as an array (n,). Numbers are not copied."""
    is_plain = chunk.null_count == 0 and (pa.types.is_integer(chunk.type) or pa.types.is_floating(chunk.type))
    plain: np.ndarray[Any, Any] = np.from_dlpack(chunk) if is_plain and len(chunk) else chunk.to_numpy(False)
    return plain


END = b"\xff\xff\xff\xff\x00\x00\x00\x00"
"""End mark of an Arrow IPC stream."""
_OPENING, _OPENING_CRC, _NUMBER, _CRC = b"rig.opening", b"rig.opening_crc32", b"number", b"crc32"
MOST_BYTES = 4_000_000_000
"""Largest chunk file. A recorded chunk has about 20 MB, an imported table at most the size of the CSV."""
_CELL_BYTES, _MOST_DECODED = 8, 800_000_000
"""Bytes per number, and largest decoded size. A recorded chunk has 200 000 rows, a table 20 million cells."""
_NO_MEMORY = "not enough memory"
_ZEROS = (StopIteration, EOFError)
"""Exceptions raised by Arrow for zeros."""
# all exceptions observed with damaged bytes
_DAMAGE = (pa.ArrowException, OSError, MemoryError, ValueError, LookupError, TypeError, struct.error, *_ZEROS)


@dataclass(frozen=True)
class Salvage:
    batches: tuple[pa.RecordBatch, ...]
    closed: bool
    unread: int
    damage: str | None

    @property
    def rows(self) -> int:
        return sum(batch.num_rows for batch in self.batches)


def with_opening(schema: pa.Schema, opening: bytes) -> pa.Schema:
    return schema.with_metadata({_OPENING: opening, _OPENING_CRC: _digits(zlib.crc32(opening))})


def opening_in(data: bytes) -> bytes | None:
    source = pa.BufferReader(data)
    try:
        parquet = data.startswith(b"PAR1")
        schema = pq.read_schema(source) if parquet else pa.ipc.open_stream(source).schema
        metadata = schema.metadata or {}
        opening = bytes(metadata[_OPENING])
        return opening if _digits(zlib.crc32(opening)) == metadata[_OPENING_CRC] else None
    except _DAMAGE:
        return None


def head(schema: pa.Schema) -> bytes:
    return bytes(schema.serialize().to_pybytes())


def frame(batch: pa.RecordBatch, number: int) -> bytes:
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, batch.schema) as writer:
        marks = {_NUMBER: _digits(number), _CRC: _digits(checksum(batch, number))}
        writer.write_batch(batch, custom_metadata=marks)
    return bytes(sink.getvalue().to_pybytes()[len(head(batch.schema)) : -len(END)])


def salvage(data: bytes, schema: pa.Schema) -> Salvage:
    """Read a recording chunk of a known schema up to the first damage. Raises OSError without memory."""
    as_stored, sound_head = _read(data, schema), head(schema)
    if data.startswith(sound_head):
        return as_stored
    # Another version of Arrow may write a different head, so the head of the file has precedence. If it is damaged, no
    # batch is lost, because its content is known.
    mended = _read(sound_head + data[len(sound_head) :], schema)
    if mended.rows <= as_stored.rows:
        return as_stored
    damage = "the head is damaged" + (f", {mended.damage}" if mended.damage else "")
    return replace(mended, damage=damage)


def _read(data: bytes, schema: pa.Schema) -> Salvage:
    batches: list[pa.RecordBatch] = []
    end, closed, damage = 0, False, None
    try:
        source, whole = pa.BufferReader(data), pa.py_buffer(data)
        reader = pa.ipc.open_stream(source, options=pa.ipc.IpcReadOptions(use_threads=False))
        if not reader.schema.equals(schema):
            raise ValueError("another schema")
        end = source.tell()
        while end < len(data) and not closed:
            closed = len(data) - end == len(END) and data.endswith(END)
            if not closed:
                message = pa.ipc.read_message(whole.slice(end))
                # A compressed batch may expand to any number of rows.
                if message.type != "record batch" or _has_compression(message.metadata.to_pybytes()):
                    raise ValueError("has a different format than recorded")
                batch, metadata = reader.read_next_batch_with_custom_metadata()
                batch.validate(full=True)
                stored = dict(metadata or {})
                if stored.get(_CRC) != _digits(checksum(batch, len(batches))):
                    raise ValueError("checksum mismatch")
                batches.append(batch)
                end = source.tell()
    except _DAMAGE as error:
        if isinstance(error, MemoryError):  # a damaged length exceeds any memory, but is the computer short of it?
            try:
                bytearray(len(data))
            except MemoryError:
                raise OSError(errno.ENOMEM, _NO_MEMORY) from None
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        reason = "zeros or an early end mark" if isinstance(error, _ZEROS) else reason
        damage = f"damaged after {len(batches)} batches ({reason})"
    unread = 0 if closed else len(data) - end
    return Salvage(tuple(batches), closed, unread, damage)


def _has_compression(metadata: bytes) -> bool:
    """True if field 3 of RecordBatch, in field 2 of Message (Arrow, format/Message.fbs), specifies compression."""
    message = _number(metadata, 0, "I")
    header = message + _field(metadata, message, 2)
    return _field(metadata, header + _number(metadata, header, "I"), 3) > 0


def _field(data: bytes, table: int, k: int) -> int:
    offsets = table - _number(data, table, "i")
    return _number(data, offsets + 4 + 2 * k, "H") if 4 + 2 * k < _number(data, offsets, "H") else 0


def _number(data: bytes, at: int, kind: str) -> int:
    (number,) = struct.unpack_from(f"<{kind}", data, at)
    return int(number)


def _digits(number: int) -> bytes:
    return str(number).encode()


def table_of(batches: tuple[pa.RecordBatch, ...], schema: pa.Schema) -> pa.Table:
    return pa.Table.from_batches(batches, schema.remove_metadata()).replace_schema_metadata(schema.metadata)


def to_parquet(table: pa.Table) -> bytes:
    """Encode a table as Parquet, and verify that it can be read back bit for bit.

    Dictionaries are disabled, because they would merge nans with different bits.
    """
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink, compression="zstd", use_dictionary=False)
    data = bytes(sink.getvalue().to_pybytes())
    back = from_parquet(data)
    if back is None or not back.schema.equals(table.schema) or _digest(back) != _digest(table):
        raise pa.ArrowInvalid("the Parquet file cannot be read back unchanged")
    return data


def from_parquet(data: bytes, columns: Sequence[str] | None = None) -> pa.Table | None:
    """Table in a Parquet file, or selected columns. None if bytes are invalid or text is not UTF-8.

    Raises OSError if memory is insufficient, or if the decoded data exceeds the size of a chunk: a few bytes can
    represent any number of equal rows, and each row a long text. Only the calling thread is used, because Arrow threads
    still active at exit abort the program (apache/arrow issue 34314).
    """
    try:
        return _decoded(data, columns)
    except MemoryError:
        raise OSError(errno.ENOMEM, _NO_MEMORY) from None
    except _DAMAGE as error:
        if getattr(error, "errno", None) == errno.EFBIG:
            raise
        return None


def _decoded(data: bytes, columns: Sequence[str] | None) -> pa.Table:
    file = pq.ParquetFile(pa.BufferReader(data), pre_buffer=False)
    rows, width, schema = file.metadata.num_rows, file.metadata.num_columns, file.schema_arrow
    groups = [file.metadata.row_group(k) for k in range(file.metadata.num_row_groups)]
    unpacked = sum(group.column(k).total_uncompressed_size for group in groups for k in range(group.num_columns))
    if max(rows * width * _CELL_BYTES, unpacked) > _MOST_DECODED:  # a repeated dictionary value is counted once
        raise OSError(errno.EFBIG, f"{rows} rows of {width} columns exceed the limits of a chunk")
    # Text is read as indices of distinct texts, which gives its total size.
    text = [field.name for field in schema if pa.types.is_string(field.type) or pa.types.is_binary(field.type)]
    if text:
        source = pa.BufferReader(data)
        file = pq.ParquetFile(source, metadata=file.metadata, pre_buffer=False, read_dictionary=text)
    table = file.read(columns, use_threads=False)
    if text:
        import pyarrow.compute as pc  # noqa: PLC0415 - wraps 286 functions; only tables and faults have text

        parts = [part for name in text if name in table.column_names for part in table.column(name).chunks]
        lengths = [pc.binary_length(part.dictionary).take(part.indices) for part in parts]
        if sum(pc.sum(part_lengths).as_py() or 0 for part_lengths in lengths) > _MOST_DECODED:
            raise OSError(errno.EFBIG, "the text exceeds the limit of a chunk")
        table = table.cast(pa.schema([schema.field(name) for name in table.column_names], schema.metadata))
    table.validate(full=True)
    return table


def _digest(table: pa.Table) -> list[int]:
    return [checksum(batch, 0) for batch in table.combine_chunks().to_batches()]

"""The bytes of a chunk: an Arrow IPC stream while recording, Parquet once it is full.

Arrow's stream has no checksum, and zeros at a batch boundary read as its clean end. So each batch
carries its number and a CRC-32 over its columns, and reading counts bytes: whatever follows the last
verified batch and is not exactly the end mark is damage. Bytes in, batches out; nothing here touches
a file, and no damage raises: a damaged chunk is an expected thing.

The schema of each file also holds the run's opening manifest, so that any one surviving chunk says
which run, rig and clock it belongs to.
"""

from __future__ import annotations

import errno
import struct
import zlib
from dataclasses import dataclass, replace

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from daq.store.schema import checksum

END = b"\xff\xff\xff\xff\x00\x00\x00\x00"
"""What closes an Arrow IPC stream."""
_OPENING, _OPENING_CRC, _NUMBER, _CRC = b"rig.opening", b"rig.opening_crc32", b"number", b"crc32"
MOST_BYTES = 4_000_000_000
"""The largest file of a chunk; one that is recorded has some 20 MB, an imported table at most what its CSV has."""
_CELL_BYTES, _MOST_DECODED = 8, 800_000_000
"""Bytes of a number, and of all numbers of a chunk, or of all its text: one that is recorded has 200 000 rows, a table
20 million cells."""
_NO_MEMORY = "not enough memory"
_ZEROS = (StopIteration, EOFError)
"""What Arrow raises on zeros."""
# Everything that damaged bytes have been seen to raise.
_DAMAGE = (pa.ArrowException, OSError, MemoryError, ValueError, LookupError, TypeError, struct.error, *_ZEROS)


@dataclass(frozen=True)
class Salvage:
    """What a recording chunk holds.

    batches: every complete, verified batch up to the first damage. closed: the end mark was there.
    damage: what is wrong, None for a sound chunk. unread: bytes left unread, 0 for a sound chunk.
    """

    batches: tuple[pa.RecordBatch, ...]
    closed: bool
    unread: int
    damage: str | None

    @property
    def rows(self) -> int:
        """The number of rows in all batches."""
        return sum(batch.num_rows for batch in self.batches)


def with_opening(schema: pa.Schema, opening: bytes) -> pa.Schema:
    """Return the schema with the run's opening manifest (JSON) and its checksum in the metadata."""
    return schema.with_metadata({_OPENING: opening, _OPENING_CRC: _digits(zlib.crc32(opening))})


def opening_in(data: bytes) -> bytes | None:
    """Return the opening manifest in the bytes of a chunk of either kind; None if it cannot be verified."""
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
    """Return the bytes that a recording chunk begins with."""
    return bytes(schema.serialize().to_pybytes())


def frame(batch: pa.RecordBatch, number: int) -> bytes:
    """Return one batch as it is appended to a recording chunk; `number` counts from 0 in each file."""
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, batch.schema) as writer:
        marks = {_NUMBER: _digits(number), _CRC: _digits(checksum(batch, number))}
        writer.write_batch(batch, custom_metadata=marks)
    return bytes(sink.getvalue().to_pybytes()[len(head(batch.schema)) : -len(END)])


def salvage(data: bytes, schema: pa.Schema) -> Salvage:
    """Read a recording chunk of a known schema as far as it is sound. Raises OSError only where the memory is short."""
    as_stored, sound_head = _read(data, schema), head(schema)
    if data.startswith(sound_head):
        return as_stored
    # Another version of Arrow may write another head, so the file's own comes first. A damaged one
    # costs no batch, since what belongs there is known.
    mended = _read(sound_head + data[len(sound_head) :], schema)
    if mended.rows <= as_stored.rows:
        return as_stored
    damage = "its head is damaged" + (f", {mended.damage}" if mended.damage else "")
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
                # A compressed batch may stand for any number of rows.
                if message.type != "record batch" or _has_compression(message.metadata.to_pybytes()):
                    raise ValueError("not recorded like this")
                batch, metadata = reader.read_next_batch_with_custom_metadata()
                batch.validate(full=True)
                stored = dict(metadata or {})
                if stored.get(_CRC) != _digits(checksum(batch, len(batches))):
                    raise ValueError("checksum mismatch")
                batches.append(batch)
                end = source.tell()
    except _DAMAGE as error:
        _hold_memory(error, len(data))
        damage = f"damaged after {len(batches)} batches ({_reason(error)})"
    unread = 0 if closed else len(data) - end
    return Salvage(tuple(batches), closed, unread, damage)


def _has_compression(metadata: bytes) -> bool:
    """Return whether the metadata of a batch state a compression: the fourth field of the table RecordBatch, which is
    the third field of the table Message (Arrow, format/Message.fbs; tables and their fields as in FlatBuffers'
    internals)."""
    message = _number(metadata, 0, "I")
    header = message + _field(metadata, message, 2)
    return _field(metadata, header + _number(metadata, header, "I"), 3) > 0


def _field(data: bytes, table: int, k: int) -> int:
    """Return how far behind its table's beginning the field k of a FlatBuffers table is; 0 if it has none."""
    offsets = table - _number(data, table, "i")
    return _number(data, offsets + 4 + 2 * k, "H") if 4 + 2 * k < _number(data, offsets, "H") else 0


def _number(data: bytes, at: int, kind: str) -> int:
    (number,) = struct.unpack_from(f"<{kind}", data, at)
    return int(number)


def _digits(number: int) -> bytes:
    return str(number).encode()


def _reason(error: BaseException) -> str:
    if isinstance(error, _ZEROS):
        return "zeros or an early end mark"
    return (str(error).splitlines() or [type(error).__name__])[0]


def table_of(batches: tuple[pa.RecordBatch, ...], schema: pa.Schema) -> pa.Table:
    """Return batches as one table that carries the schema's metadata."""
    return pa.Table.from_batches(batches, schema.remove_metadata()).replace_schema_metadata(schema.metadata)


def to_parquet(table: pa.Table) -> bytes:
    """Return a table as a Parquet file that was proven to read back bit for bit.

    Raises ArrowInvalid when it does not. Without dictionaries, which would merge nans of different bits.
    """
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink, compression="zstd", use_dictionary=False)
    data = bytes(sink.getvalue().to_pybytes())
    back = from_parquet(data)
    if back is None or not back.schema.equals(table.schema) or _digest(back) != _digest(table):
        raise pa.ArrowInvalid("the Parquet file does not read back as what was written")
    return data


def from_parquet(data: bytes) -> pa.Table | None:
    """Return the table in a Parquet file; None if the bytes are not one, or hold text that is not UTF-8.

    On the calling thread alone: Arrow's own threads, still at work when Python ends, abort the program
    after its answer is printed (apache/arrow issue 34314). Raises OSError where the memory is short, or the file
    stands for more than a chunk has: a few bytes can stand for any number of equal rows, and rows for one long text.
    """
    try:
        table = _decoded(data)
    except MemoryError:
        raise OSError(errno.ENOMEM, _NO_MEMORY) from None
    except _DAMAGE:
        return None
    if isinstance(table, str):
        raise OSError(errno.EFBIG, table)
    return table


def _decoded(data: bytes) -> pa.Table | str:
    """Return the table in a Parquet file, or in words how it is larger than any chunk."""
    file = pq.ParquetFile(pa.BufferReader(data), pre_buffer=False)
    rows, columns, schema = file.metadata.num_rows, file.metadata.num_columns, file.schema_arrow
    groups = [file.metadata.row_group(k) for k in range(file.metadata.num_row_groups)]
    unpacked = sum(group.column(k).total_uncompressed_size for group in groups for k in range(group.num_columns))
    if max(rows * columns * _CELL_BYTES, unpacked) > _MOST_DECODED:  # a value of a dictionary counts once
        return f"it declares {rows} rows of {columns} columns, more than any chunk has"
    # Text is read as numbers of different texts, since how long all of it is shows only then.
    text = [field.name for field in schema if pa.types.is_string(field.type) or pa.types.is_binary(field.type)]
    source = pa.BufferReader(data)
    file = pq.ParquetFile(source, metadata=file.metadata, pre_buffer=False, read_dictionary=text)
    table = file.read(use_threads=False)
    if sum(_text_bytes(table.column(name)) for name in text) > _MOST_DECODED:
        return "its text is longer than that of any chunk"
    table = table.cast(schema)
    table.validate(full=True)
    return table


def _text_bytes(column: pa.ChunkedArray) -> int:
    """Return the bytes of a column of text that was read as numbers of different texts."""
    lengths = [pc.binary_length(part.dictionary).take(part.indices) for part in column.chunks]
    return sum(pc.sum(part_lengths).as_py() or 0 for part_lengths in lengths)


def _hold_memory(error: BaseException, size: int) -> None:
    """Raise OSError if not the file failed but the memory: if there is none for as many bytes again.

    A damaged length asks for more than any computer has; that is damage.
    """
    if isinstance(error, MemoryError):
        try:
            bytearray(size)
        except MemoryError:
            raise OSError(errno.ENOMEM, _NO_MEMORY) from None


def _digest(table: pa.Table) -> list[int]:
    return [checksum(batch, 0) for batch in table.combine_chunks().to_batches()]

"""The messages of an MCAP file in the order of the file: each chunk unpacked once, bounded, its checksum held.

A bag's index may name one chunk any number of times: 220 kB stood for 22 GB. So the index is not read; records are
taken as they come, and what they unpack to is counted in the same pass. One changed bit in a reading makes another
plausible reading, and only the checksums of chunks and of the data section show it.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import lz4.frame
import zstandard
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, DataEnd, McapRecord, Message, Schema, Statistics
from mcap.stream_reader import CRCValidationError, StreamReader, get_chunk_data_stream

from rigs.errors import FileError

MAGIC = b"\x89MCAP0\r\n"
_MOST_UNPACKED = 2_000_000_000
"""Bytes of all chunks of a bag once they are unpacked: eight times the largest file."""
_MOST_OF_CHUNK = 256_000_000
"""Bytes of one chunk, which is in memory as a whole; recorders begin another after some megabytes."""
_PIECE = 1_000_000
"""Bytes that are unpacked at a time to count them."""


class Found(NamedTuple):
    """A message with its topic and the type of the topic's messages; one that is not written as ROS 2 does has its
    encoding beside the type. log_ns, sent_ns: when it was received, and when it was sent as far as that is known."""

    topic: str
    kind: str
    log_ns: int
    sent_ns: int
    data: bytes


@dataclass
class Bag:
    """An MCAP file in memory. has_checksums: whether all messages read so far lie under one."""

    data: bytes
    where: str
    has_checksums: bool = True
    _schemas: dict[int, Schema] = field(default_factory=dict)
    _channels: dict[int, tuple[str, str]] = field(default_factory=dict)

    @property
    def is_whole(self) -> bool:
        """Whether the file ends as it begins."""
        return self.data.endswith(MAGIC)

    def messages(self) -> Iterator[Found]:
        """Yield the messages in the order of the file.

        Raises FileError for a bag that stands for too much, McapError where it contradicts itself, and of a damaged one
        whatever its decompressors raise.
        """
        count = unpacked = 0
        checked = True
        records = iter(StreamReader(io.BytesIO(self.data), emit_chunks=True, validate_crcs=True).records)
        for record in records:
            if isinstance(record, DataEnd):
                self.has_checksums = checked or record.data_section_crc != 0
                break
            if isinstance(record, Chunk):
                checked &= record.uncompressed_crc != 0
                unpacked += self._hold_size(record, unpacked)
            else:
                checked &= not isinstance(record, Message)
            for one in _records_in(record) if isinstance(record, Chunk) else (record,):
                if isinstance(one, Message):
                    count += 1
                    yield Found(*self._channels[one.channel_id], one.log_time, one.publish_time, one.data)
                else:
                    self._learn(one)
        for record in records:
            if isinstance(record, Statistics) and record.message_count != count:
                raise McapError(f"it holds {count} messages, and its statistics say {record.message_count}")

    def _learn(self, record: McapRecord) -> None:
        """Remember the schema or the channel that a record defines."""
        if isinstance(record, Schema):
            self._schemas[record.id] = record
        elif isinstance(record, Channel):
            schema = self._schemas.get(record.schema_id)
            name = schema.name if schema else ""
            kind = name if record.message_encoding == "cdr" else f"{name} as {record.message_encoding}"
            self._channels[record.id] = record.topic, kind

    def _hold_size(self, chunk: Chunk, before: int) -> int:
        """Return the bytes that a chunk unpacks to. Raises FileError where that, or all together, is too much: a few
        bytes can stand for any number."""
        size = max(chunk.uncompressed_size, _frame_bytes(chunk))
        remedy = "record the topics of joints and gauges alone, or import it in several runs"
        if before + size > _MOST_UNPACKED:
            what = f"stands for more than {_MOST_UNPACKED / 1e9:g} GB once it is unpacked"
            raise FileError(self.where, what, remedy)
        if size > _MOST_OF_CHUNK:
            raise FileError(self.where, f"holds a chunk of more than {_MOST_OF_CHUNK / 1e6:g} MB", remedy)
        return size


def words_of(error: Exception) -> str:
    """Return what is wrong with a bag that made its reader raise this."""
    if isinstance(error, CRCValidationError):
        return "its content has changed since it was recorded (CRC-32)"
    return str(error)[:80] or type(error).__name__


def _records_in(chunk: Chunk) -> Iterator[McapRecord]:
    """Yield what a chunk holds, one by one. Raises CRCValidationError where it has changed."""
    stream, size = get_chunk_data_stream(chunk, validate_crc=True)
    while stream.count < size:
        opcode, length = stream.read1(), stream.read8()
        if opcode == Opcode.CHANNEL:
            yield Channel.read(stream)
        elif opcode == Opcode.SCHEMA:
            yield Schema.read(stream)
        elif opcode == Opcode.MESSAGE:
            yield Message.read(stream, length)
        else:
            stream.read(length)


def _frame_bytes(chunk: Chunk) -> int:
    """Return the bytes that the frame of a compressed chunk unpacks to, as far as that is known before."""
    if chunk.compression == "zstd":
        return int(zstandard.frame_content_size(chunk.data))  # -1: unknown, and unpacked no further than the chunk says
    return _lz4_bytes(chunk.data) if chunk.compression == "lz4" else len(chunk.data)


def _lz4_bytes(data: bytes) -> int:
    """Return the bytes that an lz4 frame unpacks to, a piece at a time: it need not state them."""
    frame, total = lz4.frame.LZ4FrameDecompressor(), 0
    while not frame.eof and total <= _MOST_UNPACKED:
        piece = frame.decompress(data, max_length=_PIECE)
        if not piece and frame.needs_input:
            break  # it is cut off, as its reader will find
        data, total = b"", total + len(piece)
    return total

"""A bag of ROS 2 in either of the formats of `ros2 bag record`, and its messages in the order of the file.

Of an MCAP file each chunk is unpacked once, bounded, its checksum held. A bag's index may name one chunk any number of
times: 220 kB stood for 22 GB. So the index is not read; records are taken as they come, and what they unpack to is
counted in the same pass. One changed bit in a reading makes another plausible reading, and only the checksums of chunks
and of the data section show it.

rosbag2's first format is SQLite. A database can hold views and triggers that compute without end. So only plain tables
are read, in the order of their times, and only for so many steps. It has no checksums: a changed bit in a message makes
another message.

The messages that rig reads are taken from CDR by their layout, which is fixed; a general reader would build code from
the text of definitions in a file that somebody else made.

Sources: OMG DDSI-RTPS 2.3, 10 (CDR), and ros2/common_interfaces, sensor_msgs, geometry_msgs and std_msgs.
"""

from __future__ import annotations

import io
import sqlite3
import struct
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import NamedTuple

import lz4.frame
import zstandard
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, DataEnd, McapRecord, Message, Schema, Statistics
from mcap.stream_reader import CRCValidationError, StreamReader, get_chunk_data_stream

from rigs.errors import FileError
from rigs.files import out_of_memory
from rigs.text import as_argument

MCAP_MAGIC = b"\x89MCAP0\r\n"
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
class McapBag:
    """An MCAP file in memory. has_checksums: whether all messages read so far lie under one."""

    data: bytes
    where: str
    has_checksums: bool = True
    _schemas: dict[int, Schema] = field(default_factory=dict)
    _channels: dict[int, tuple[str, str]] = field(default_factory=dict)

    @property
    def is_whole(self) -> bool:
        """Whether the file ends as it begins."""
        return self.data.endswith(MCAP_MAGIC)

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
                size = max(record.uncompressed_size, _frame_bytes(record))  # a few bytes can stand for any number
                remedy = "record the topics of joints and gauges alone, or import the file in several runs"
                if (unpacked := unpacked + size) > _MOST_UNPACKED:
                    problem = f"stands for more than {_MOST_UNPACKED / 1e9:g} GB once it is unpacked"
                    raise FileError(self.where, problem, remedy)
                if size > _MOST_OF_CHUNK:
                    raise FileError(self.where, f"holds a chunk of more than {_MOST_OF_CHUNK / 1e6:g} MB", remedy)
            else:
                checked &= not isinstance(record, Message)
            for part in _records_in(record) if isinstance(record, Chunk) else (record,):
                if isinstance(part, Message):
                    count += 1
                    yield Found(*self._channels[part.channel_id], part.log_time, part.publish_time, part.data)
                # Remember the schema or the channel that a record defines.
                elif isinstance(part, Schema):
                    self._schemas[part.id] = part
                elif isinstance(part, Channel):
                    schema = self._schemas.get(part.schema_id)
                    name = schema.name if schema else ""
                    kind = name if part.message_encoding == "cdr" else f"{name} as {part.message_encoding}"
                    self._channels[part.id] = part.topic, kind
        for record in records:
            if isinstance(record, Statistics) and record.message_count != count:
                raise McapError(f"it holds {count} messages, and its statistics say {record.message_count}")


def words_of(error: Exception) -> str:
    """Return what is wrong with a bag that made its reader raise this."""
    if isinstance(error, CRCValidationError):
        return "the content has changed since it was recorded (CRC-32)"
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
    if chunk.compression != "lz4":
        return len(chunk.data)
    # A piece at a time: an lz4 frame need not state it.
    frame, total, data = lz4.frame.LZ4FrameDecompressor(), 0, chunk.data
    while not frame.eof and total <= _MOST_UNPACKED:
        piece = frame.decompress(data, max_length=_PIECE)
        if not piece and frame.needs_input:
            break  # it is cut off, as its reader will find
        data, total = b"", total + len(piece)
    return total


SQLITE_MAGIC = b"SQLite format 3\0"
_VERSIONS, _NO_LOG = 18, b"\1\1"
"""Where a header says whether a log beside the file is used (WAL, of rosbag2's resilient preset), and that none is: a
database in memory has none (sqlite.org, Database File Format, 1.3.3)."""
_MOST_STEPS = 500_000_000
"""Steps of SQLite's virtual machine: half a minute, and several times what five million messages take."""
_STEPS = 1_000_000
_PLAIN = "SELECT count(*) FROM sqlite_master WHERE name IN ('messages', 'topics') AND type = 'table' AND rootpage > 0"
_MESSAGES = """SELECT topics.name, topics.type, topics.serialization_format, messages.timestamp, messages.data
FROM messages JOIN topics ON messages.topic_id = topics.id ORDER BY messages.timestamp"""


@dataclass(frozen=True)
class SqliteBag:
    """A database in memory."""

    data: bytes
    where: str
    has_checksums = False
    is_whole = True

    def messages(self) -> Iterator[Found]:
        """Yield the messages in the order in which they were received.

        Raises sqlite3.Error for a damaged database, and for one that is no bag.
        """
        steps = iter(range(_MOST_STEPS // _STEPS))
        with closing(sqlite3.connect(":memory:")) as database:
            database.deserialize(self.data[:_VERSIONS] + _NO_LOG + self.data[_VERSIONS + len(_NO_LOG) :])
            database.execute("PRAGMA trusted_schema = OFF")
            database.set_progress_handler(lambda: next(steps, None) is None, _STEPS)
            if database.execute(_PLAIN).fetchone() != (2,):
                raise sqlite3.DatabaseError("it has no tables messages and topics, as a bag of ROS 2 has")
            for topic, kind, form, log_ns, data in database.execute(_MESSAGES):
                if isinstance(data, bytes) and isinstance(log_ns, int):
                    yield Found(str(topic), str(kind) if form == "cdr" else f"{kind} as {form}", log_ns, log_ns, data)


Bag = McapBag | SqliteBag
_LAST_NS = 2**62
"""The year 2116: no bag is of a later one, and all reckoning with times is in 64 bits."""
_SUFFIXES = (".mcap", ".db3")


def is_bag(data: bytes) -> bool:
    """Return whether the bytes of a file are those of a bag."""
    return data.startswith((MCAP_MAGIC, SQLITE_MAGIC))


def bag_of(data: bytes, where: str) -> Bag:
    """The bag in the bytes of a file."""
    return (SqliteBag if data.startswith(SQLITE_MAGIC) else McapBag)(data, where)


def file_of(path: Path) -> Path:
    """Return the file of a bag in the directory that `ros2 bag record` made; any other path as it is.

    Raises FileError for a directory with no such file, or several, and for a file whose end is in a log beside it.
    """
    files = sorted(file for file in path.iterdir() if file.suffix in _SUFFIXES) if path.is_dir() else [path]
    if len(files) == 1:
        log = files[0].with_name(f"{files[0].name}-wal")
        if log.exists() and log.stat().st_size:
            remedy = f"write it into the bag: sqlite3 {as_argument(str(files[0]))} 'PRAGMA wal_checkpoint(TRUNCATE)'"
            raise FileError(str(files[0]), f"was not closed: its last messages are in {log.name}", remedy)
        return files[0]
    problem = f"is a directory with {len(files) or 'no'} files of a bag ({' or '.join(_SUFFIXES)})"
    remedy = "make one bag of them: ros2 bag convert" if files else "give the file, or the directory of ros2 bag record"
    raise FileError(str(path), problem, remedy)


def messages_of(bag: Bag) -> Iterator[Found]:
    """Yield the messages of a bag. Raises FileError where it is cut off or damaged."""
    if not bag.is_whole:
        remedy = "copy the bag again, or mend one whose recorder was killed: mcap recover BAG -o WHOLE"
        raise FileError(bag.where, "is cut off: a bag ends as it begins", remedy)
    try:
        for message in bag.messages():
            if not max(message.log_ns, message.sent_ns) < _LAST_NS:
                raise ValueError("a message has an impossible time")
            yield message
    except FileError:
        raise
    except MemoryError:
        raise out_of_memory(Path(bag.where)) from None
    except Exception as error:  # noqa: BLE001 - of a damaged file, whatever its decompressors raise
        raise FileError(bag.where, f"is damaged: {words_of(error)}", "copy the bag again") from None


JOINT_STATE, NUMBER, TF = "sensor_msgs/msg/JointState", "std_msgs/msg/Float64", "tf2_msgs/msg/TFMessage"
NO_STAMP = 0


class Cdr:
    """A serialised message: the encapsulation header of four bytes, then fields, each at a multiple of its size.
    Reading beyond its end raises struct.error or IndexError."""

    def __init__(self, data: bytes) -> None:
        self._body = data[4:]
        self._order = "<" if data[1] & 1 else ">"
        self._at = 0

    def take(self, code: str, count: int = 1) -> tuple[float, ...]:
        """Take so many numbers of a format of `struct`."""
        size = struct.calcsize(code)
        self._at += -self._at % size if count else 0
        values = struct.unpack_from(f"{self._order}{count}{code}", self._body, self._at)
        self._at += size * count
        return values

    def count(self) -> int:
        """Take the length of what follows; no more than there is."""
        return min(int(self.take("I")[0]), len(self._body))

    def text(self) -> str:
        """Take a text."""
        size = self.count()
        (encoded,) = struct.unpack_from(f"{size}s", self._body, self._at)
        self._at += size
        return str(encoded.rstrip(b"\0"), "utf-8", "replace")

    def header(self) -> int:
        """Take a header: its stamp in ns, 0 for none."""
        seconds, nanoseconds = (int(part) for part in self.take("I", 2))
        self.text()
        return seconds * 10**9 + nanoseconds


def joint_state(data: bytes) -> tuple[int, dict[str, float]]:
    """Return the stamp in ns and the angle in rad of each joint of a JointState."""
    message = Cdr(data)
    stamp_ns = message.header()
    names = [message.text() for _ in range(message.count())]
    positions = message.take("d", message.count())
    return stamp_ns, dict(zip(names, positions, strict=False))


def number(data: bytes) -> float:
    """Return the number of a Float64."""
    return float(Cdr(data).take("d")[0])


class Placed(NamedTuple):
    """A place in m and a turn as a quaternion x, y, z, w, empty for a message without; child: the frame that is placed,
    where the message names it."""

    stamp_ns: int
    child: str
    place_m: tuple[float, ...]
    turn: tuple[float, ...]


def _placed(data: bytes, *, turn: int = 4, child: bool = False) -> Iterator[Placed]:
    """One place with a turn of so many numbers; child: the message names what it places."""
    message = Cdr(data)
    stamp_ns = message.header()
    if child:
        message.text()
    yield Placed(stamp_ns, "", message.take("d", 3), message.take("d", turn))


def _transforms(data: bytes) -> Iterator[Placed]:
    message = Cdr(data)
    for _ in range(message.count()):
        yield Placed(message.header(), message.text(), message.take("d", 3), message.take("d", 4))


PLACED: Mapping[str, Callable[[bytes], Iterator[Placed]]] = {
    "geometry_msgs/msg/PointStamped": partial(_placed, turn=0),
    "geometry_msgs/msg/PoseStamped": _placed,
    "geometry_msgs/msg/PoseWithCovarianceStamped": _placed,
    "geometry_msgs/msg/TransformStamped": partial(_placed, child=True),
    TF: _transforms,
}
"""What places something, by the type of the message; all but TF place one thing a topic."""

"""ROS 2 bags in both formats of `ros2 bag record`, and their messages in file order.

MCAP records are read in sequence: the index may list a chunk any number of times (a file of 220 kB claimed 22 GB). An
SQLite database has no checksums, and can contain views and triggers with endless computations, so only plain tables are
read, with a limited number of steps. rosbags decodes the messages. Its reader of files is not used, because it drops
the send time of a message and unpacks a chunk as often as the index lists it.
"""

from __future__ import annotations

import io
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, field
from functools import cache
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

import lz4.frame
import zstandard
from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, DataEnd, Message, Schema, Statistics
from mcap.stream_reader import CRCValidationError, StreamReader, breakup_chunk

from rigs.distribution import to_install
from rigs.errors import CellError, FileError
from rigs.files import out_of_memory
from rigs.text import as_argument

MCAP_MAGIC = b"\x89MCAP0\r\n"
_MOST_UNPACKED = 2_000_000_000
"""Maximum size in bytes of all unpacked chunks of a bag: eight times the largest file."""
_MOST_OF_CHUNK = 256_000_000
"""Maximum size in bytes of a chunk, which is in memory completely. Recorders start a new chunk after some megabytes."""
_PIECE = 1_000_000


class BagMessage(NamedTuple):
    topic: str
    kind: str
    """Message type, with the encoding appended if it is not CDR."""
    log_ns: int
    sent_ns: int
    """Time of sending if known, else of reception."""
    data: bytes


@dataclass
class McapBag:
    data: bytes
    where: str
    has_checksums: bool = True
    """True if checksums cover all messages read so far."""
    _schemas: dict[int, Schema] = field(default_factory=dict)
    _channels: dict[int, tuple[str, str]] = field(default_factory=dict)

    @property
    def is_complete(self) -> bool:
        return self.data.endswith(MCAP_MAGIC)

    def messages(self) -> Iterator[BagMessage]:
        """Yield the messages in file order.

        Raises FileError for a bag that is too large, and any error of the decompressors for a damaged one.
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
                size = max(record.uncompressed_size, _frame_bytes(record))  # A few bytes can claim any size.
                remedy = "record the topics of joints and gauges only, or import the file in several runs"
                if (unpacked := unpacked + size) > _MOST_UNPACKED:
                    problem = f"expands to more than {_MOST_UNPACKED / 1e9:g} GB"
                    raise FileError(self.where, problem, remedy, code="file.too_large")
                if size > _MOST_OF_CHUNK:
                    problem = f"contains a chunk of more than {_MOST_OF_CHUNK / 1e6:g} MB"
                    raise FileError(self.where, problem, remedy, code="file.too_large")
            else:
                checked &= not isinstance(record, Message)
            for part in breakup_chunk(record, validate_crc=True) if isinstance(record, Chunk) else (record,):
                if isinstance(part, Message):
                    count += 1
                    yield BagMessage(*self._channels[part.channel_id], part.log_time, part.publish_time, part.data)
                elif isinstance(part, Schema):
                    self._schemas[part.id] = part
                elif isinstance(part, Channel):
                    schema = self._schemas.get(part.schema_id)
                    name = schema.name if schema else ""
                    kind = name if part.message_encoding == "cdr" else f"{name} as {part.message_encoding}"
                    self._channels[part.id] = part.topic, kind
        for record in records:
            if isinstance(record, Statistics) and record.message_count != count:
                raise McapError(f"the bag contains {count} messages, but its statistics state {record.message_count}")


def _frame_bytes(chunk: Chunk) -> int:
    """Unpacked size in bytes of the frame of a compressed chunk, if known in advance."""
    if chunk.compression == "zstd":
        return int(zstandard.frame_content_size(chunk.data))  # -1 is unknown: the chunk then limits the size
    if chunk.compression != "lz4":
        return len(chunk.data)
    # In pieces, because an lz4 frame need not state the size
    frame, total, data = lz4.frame.LZ4FrameDecompressor(), 0, chunk.data
    while not frame.eof and total <= _MOST_UNPACKED:
        piece = frame.decompress(data, max_length=_PIECE)
        if not piece and frame.needs_input:
            break  # The frame is truncated, which the decoder will report.
        data, total = b"", total + len(piece)
    return total


SQLITE_MAGIC = b"SQLite format 3\0"
_VERSIONS, _NO_LOG = 18, b"\1\1"
"""Position in the header of the flags for a log file (WAL), and the value for none, as in memory (sqlite.org, Database
File Format, 1.3.3)."""
_MOST_STEPS = 500_000_000
"""Maximum number of steps of SQLite's virtual machine: half a minute, several times the steps for five million
messages.
"""
_STEPS = 1_000_000
_PLAIN = "SELECT count(*) FROM sqlite_master WHERE name IN ('messages', 'topics') AND type = 'table' AND rootpage > 0"
_MESSAGES = """SELECT topics.name, topics.type, topics.serialization_format, messages.timestamp, messages.data
FROM messages JOIN topics ON messages.topic_id = topics.id ORDER BY messages.timestamp"""


@dataclass(frozen=True)
class SqliteBag:
    data: bytes
    where: str
    has_checksums = False
    is_complete = True

    def messages(self) -> Iterator[BagMessage]:
        """Yield the messages in the order of reception. Raises sqlite3.Error for a database that is no intact bag."""
        steps = iter(range(_MOST_STEPS // _STEPS))
        with closing(sqlite3.connect(":memory:")) as database:
            database.deserialize(self.data[:_VERSIONS] + _NO_LOG + self.data[_VERSIONS + len(_NO_LOG) :])
            database.execute("PRAGMA trusted_schema = OFF")
            database.set_progress_handler(lambda: next(steps, None) is None, _STEPS)
            if database.execute(_PLAIN).fetchone() != (2,):
                raise sqlite3.DatabaseError("the tables messages and topics of a ROS 2 bag are missing")
            for topic, name, form, log_ns, data in database.execute(_MESSAGES):
                if isinstance(data, bytes) and isinstance(log_ns, int):
                    kind = str(name) if form == "cdr" else f"{name} as {form}"
                    yield BagMessage(str(topic), kind, log_ns, log_ns, data)


Bag = McapBag | SqliteBag
_LAST_NS = 2**62
"""Latest valid time, the year 2116: keeps computations with times within 64 bits."""
_SUFFIXES = (".mcap", ".db3")


def is_bag(data: bytes) -> bool:
    return data.startswith((MCAP_MAGIC, SQLITE_MAGIC))


def bag_of(data: bytes, where: str) -> Bag:
    return (SqliteBag if data.startswith(SQLITE_MAGIC) else McapBag)(data, where)


def file_of(path: Path) -> Path:
    """Find the file of a bag in a directory written by `ros2 bag record`; any other path is returned unchanged.

    Raises FileError unless there is exactly one such file, and if a separate log still contains messages.
    """
    files = sorted(file for file in path.iterdir() if file.suffix in _SUFFIXES) if path.is_dir() else [path]
    if len(files) != 1:
        problem = f"is a directory with {len(files) or 'no'} files of a bag ({' or '.join(_SUFFIXES)})"
        several = "merge the files into a single bag: ros2 bag convert"
        remedy = several if files else "give the file, or the directory of ros2 bag record"
        raise FileError(str(path), problem, remedy, code="table.invalid")
    file = str(files[0])
    log = Path(f"{file}-wal")
    if log.exists() and log.stat().st_size:
        problem = f"was not closed: the last messages are still in {log.name}"
        remedy = f"write that file into the bag: sqlite3 {as_argument(file)} 'PRAGMA wal_checkpoint(TRUNCATE)'"
        raise FileError(file, problem, remedy, code="table.invalid")
    return files[0]


def messages_of(bag: Bag) -> Iterator[BagMessage]:
    if not bag.is_complete:
        remedy = "copy the bag a second time, or repair an interrupted recording: mcap recover BAG -o REPAIRED"
        raise FileError(bag.where, "is truncated: the magic bytes at the end are missing", remedy, code="table.invalid")
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
        damage = str(error)[:80] or type(error).__name__
        if isinstance(error, CRCValidationError):
            damage = "the content has changed since it was recorded (CRC-32)"
        raise FileError(bag.where, f"is damaged: {damage}", "copy the bag again", code="table.invalid") from None


JOINT_STATE, NUMBER, TF = "sensor_msgs/msg/JointState", "std_msgs/msg/Float64", "tf2_msgs/msg/TFMessage"
PLACED = {
    "geometry_msgs/msg/PointStamped": ("point",),
    "geometry_msgs/msg/PoseStamped": ("pose.position", "pose.orientation"),
    "geometry_msgs/msg/PoseWithCovarianceStamped": ("pose.pose.position", "pose.pose.orientation"),
    "geometry_msgs/msg/TransformStamped": ("transform.translation", "transform.rotation"),
    TF: ("transform.translation", "transform.rotation"),
}
"""Fields with the position in m, and the quaternion if any, by message type. Except for TF, a topic describes a single
object."""
NO_STAMP = 0


@cache
def message_decoder() -> Callable[[bytes, str], Any]:
    """Decoder of rosbags, which checks each length in a message before it allocates anything."""
    try:
        from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415 - an extra of the package
    except ModuleNotFoundError:
        problem = "a bag of ROS 2 needs the Python package rosbags, which is not installed"
        raise CellError("rig import", problem, to_install("rosbags"), code="package.missing") from None
    decode: Callable[[bytes, str], Any] = get_typestore(Stores.ROS2_HUMBLE).deserialize_cdr
    return decode


def decoded(data: bytes, kind: str) -> Any:
    """A message with the fields of its ROS type; None if the data is no such message."""
    decode = message_decoder()
    try:
        return decode(data, kind)
    except Exception:  # noqa: BLE001 - of a damaged message, whatever the decoder raises
        return None


def stamp_ns(message: Any) -> int:
    """Timestamp of the header since 1970; 0 if there is none."""
    stamp = message.header.stamp
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def joint_state(data: bytes) -> tuple[int, dict[str, float]]:
    """Stamp in ns, and angles in rad by joint; none if the message is damaged."""
    message = decoded(data, JOINT_STATE)
    if message is None:
        return NO_STAMP, {}
    return stamp_ns(message), dict(zip(message.name, message.position.tolist(), strict=False))


def numbers(message: Any, field: str) -> list[float]:
    """Coordinates of a point, vector or quaternion in a message: x, y, z, then w if any."""
    value = attrgetter(field)(message)
    return [float(getattr(value, name)) for name in "xyzw" if hasattr(value, name)]

"""A bag of ROS 2 (MCAP, rosbag2's own format) as the table of a circle, which is then read like any other.

Joints come from the topic of `sensor_msgs/msg/JointState` that the rig file names (`ros2_joint_states`), gauges from
topics of `std_msgs/msg/Float64` by their names, `/g1` and `/g2`, in mm. Such a number has no stamp, so that all times
are those at which the bag's recorder received a message: one clock, and late by what the network took. Gauge 1 sets
the rows; the rest is interpolated, and rows at gaps are left out and counted, as `analysis.traces.align` does.

The two messages are taken from CDR here: their layout is fixed, where a general reader would build code from the text
of definitions in a file that somebody else made.
"""

from __future__ import annotations

import csv
import io
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import lz4.frame
import numpy as np
import zstandard
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, Schema
from mcap.stream_reader import StreamReader

from analysis.kinematics.arm import Array
from analysis.traces.align import JUMPS_NS, MOVES_NS, gaps_ns
from rigs.errors import FileError
from rigs.files import out_of_memory
from rigs.rig import Rig
from rigs.schema.ros2 import ROS2JointStates

MAGIC = b"\x89MCAP0\r\n"
_MOST_MESSAGES = 5_000_000
"""The most that are read of one topic; half an hour at 1 kHz has 1.8 million."""
_MOST_UNPACKED = 2_000_000_000
"""Bytes of all chunks of a bag once they are unpacked: eight times the largest file."""
_PIECE = 1_000_000
"""Bytes that are unpacked at a time to count them."""
_JOINT_STATE, _NUMBER = "sensor_msgs/msg/JointState", "std_msgs/msg/Float64"


@dataclass
class _Track:
    """Messages of one topic: log times in ns, and values. read: None for a message that lacks a joint. lacking: how
    many have no such values, are not of this layout, or are no later than the one before."""

    schema: str
    read: Callable[[bytes], list[float] | None]
    ns: list[int]
    values: list[list[float]]
    lacking: int = 0

    def add(self, ns: int, data: bytes) -> None:
        try:
            values = self.read(data)
        except (struct.error, IndexError):
            values = None
        if values is None or not np.isfinite(values).all() or (self.ns and ns <= self.ns[-1]):
            self.lacking += 1
            return
        self.ns.append(ns)
        self.values.append(values)


def table_of_bag(data: bytes, where: str, rig: Rig) -> tuple[bytes, tuple[str, ...]]:
    """Return the CSV of a bag's bytes, and doubts in words. Raises FileError."""
    tracks = _read(data, where, rig)
    doubts = [
        f"{topic}: left out {one.lacking} of {one.lacking + len(one.ns)} messages, which lack a joint or a finite "
        "number, or are no later than the one before"
        for topic, one in tracks.items()
        if one.lacking
    ]
    begin_ns = min(one.ns[0] for one in tracks.values())  # since 1970, a float has steps of 256 ns
    timed = ((np.array(one.ns) - begin_ns).astype(float) for one in tracks.values())
    joints, first, *others = zip(timed, (np.array(one.values) for one in tracks.values()), strict=True)
    rows_ns = first[0]
    keep = np.ones(len(rows_ns), dtype=bool)
    for (ns, _), short_ns in zip([joints, *others], [MOVES_NS, *[JUMPS_NS] * len(others)], strict=True):
        keep &= (rows_ns >= ns[0]) & (rows_ns <= ns[-1]) & (gaps_ns(rows_ns, ns, short_ns) == 0)
    if keep.sum() < 2:
        raise FileError(where, "joints and gauges were never recorded at the same time", "record all topics together")
    if dropped := int((~keep).sum()):
        doubts.append(f"{dropped} of {len(keep)} rows are left out at gaps, and before and after the other topics")
    doubts.append("times are those at which the bag received each message: how late that was is in no uncertainty")
    rows_ns = rows_ns[keep]
    parts = [np.interp(rows_ns, ns, column) for ns, values in (joints, first, *others) for column in values.T]
    names = [*(f"q{axis}_deg" for axis in range(1, 7)), *(f"{topic[1:]}_mm" for topic in list(tracks)[1:])]
    return _csv(["t_s", *names], np.column_stack([(rows_ns - rows_ns[0]) / 1e9, *parts])), tuple(doubts)


def _read(data: bytes, where: str, rig: Rig) -> Mapping[str, _Track]:
    """The topic of the joints, then those of the gauges."""
    if not isinstance(rig.feedback, ROS2JointStates):
        remedy = "describe it in the rig file: feedback: {interface: ros2_joint_states, joints: [six names]}"
        raise FileError(where, "is a bag, and the rig file does not say which joints to take", remedy)
    if not data.endswith(MAGIC):
        remedy = "copy the bag again, or mend one whose recorder was killed: mcap recover BAG -o WHOLE"
        raise FileError(where, "is cut off: a bag ends as it begins", remedy)
    names = rig.feedback.joints
    tracks = {"/" + rig.feedback.topic.lstrip("/"): _Track(_JOINT_STATE, lambda one: _angles_deg(one, names), [], [])}
    tracks |= {f"/{name}": _Track(_NUMBER, _number, [], []) for name, _ in rig.gauges}
    found: dict[str, str] = {}
    try:
        _hold_size(data, where)
        for schema, channel, message in make_reader(io.BytesIO(data)).iter_messages():
            found[channel.topic] = _kind(schema, channel)
            track = tracks.get(channel.topic)
            if track and found[channel.topic] == track.schema and len(track.ns) < _MOST_MESSAGES:
                track.add(message.log_time, message.data)
    except FileError:
        raise
    except MemoryError:
        raise out_of_memory(Path(where)) from None
    except Exception as error:  # noqa: BLE001 - of a damaged file, whatever its decompressors raise
        raise FileError(where, f"is damaged: {str(error)[:80] or type(error).__name__}", "copy the bag again") from None
    for topic, track in tracks.items():
        if len(track.ns) >= _MOST_MESSAGES:
            raise FileError(where, f"has more than {_MOST_MESSAGES} messages of {topic}", "import it in several runs")
        if len(track.ns) < 2:
            has = ", ".join(f"{name} ({kind})" for name, kind in sorted(found.items()))[:300] or "no messages"
            what = f"holds fewer than two usable messages of {topic} ({track.schema}); it has {has}"
            raise FileError(
                where, what, "name the topic and the joints in the rig file, and the gauges' topics /g1, /g2"
            )
    return tracks


def _hold_size(data: bytes, where: str) -> None:
    """Raise FileError where the chunks of a bag stand for more than the limit: a few bytes can stand for any number,
    and the reader of bags unpacks whatever a chunk states."""
    total = 0
    for record in StreamReader(io.BytesIO(data), emit_chunks=True).records:
        if isinstance(record, Chunk):
            total += max(record.uncompressed_size, _frame_bytes(record))
        if total > _MOST_UNPACKED:
            what = f"stands for more than {_MOST_UNPACKED / 1e9:g} GB once it is unpacked"
            raise FileError(where, what, "record the topics of joints and gauges alone, or import it in several runs")


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


def _kind(schema: Schema | None, channel: Channel) -> str:
    """The type of a channel's messages; one that is not written as ROS 2 does has its encoding beside it."""
    name = schema.name if schema else ""
    return name if channel.message_encoding == "cdr" else f"{name} as {channel.message_encoding}"


def _csv(names: list[str], rows: Array) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    writer.writerows(rows.tolist())
    return text.getvalue().encode()


class _Cdr:
    """A serialised message: the encapsulation header of four bytes, then fields, each at a multiple of its size."""

    def __init__(self, data: bytes) -> None:
        self._body = data[4:]
        self._order = "<" if data[1] & 1 else ">"
        self._at = 0

    def take(self, code: str, count: int = 1) -> tuple[float, ...]:
        size = struct.calcsize(code)
        self._at += -self._at % size if count else 0
        values = struct.unpack_from(f"{self._order}{count}{code}", self._body, self._at)
        self._at += size * count
        return values

    def count(self) -> int:
        """The length of what follows; no more than there is."""
        return min(int(self.take("I")[0]), len(self._body))

    def text(self) -> str:
        size = self.count()
        (held,) = struct.unpack_from(f"{size}s", self._body, self._at)
        self._at += size
        return str(held.rstrip(b"\0"), "utf-8", "replace")


def _angles_deg(data: bytes, names: tuple[str, ...]) -> list[float] | None:
    """The six angles of a JointState; None where it lacks one."""
    message = _Cdr(data)
    message.take("I", 2)
    message.text()
    joints = [message.text() for _ in range(message.count())]
    positions = message.take("d", message.count())
    placed = dict(zip(joints, positions, strict=False))
    return [float(np.degrees(placed[name])) for name in names] if set(names) <= placed.keys() else None


def _number(data: bytes) -> list[float] | None:
    return [float(_Cdr(data).take("d")[0])]

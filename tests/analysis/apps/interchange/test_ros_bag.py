"""A bag of ROS 2 as a table, with messages that are encoded by hand."""

import csv
import io
import struct
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

from analysis.apps.interchange import bags
from analysis.apps.interchange.ros_bag import table_of_bag
from rigs.distribution import to_install
from rigs.errors import CellError, FileError
from rigs.load import SHIPPED, parse
from rigs.rig import Rig
from tests.support.bags import BEGIN_NS, JOINTS, NUMBER, STATE, bag, joint_state, number, rig
from tests.support.refusals import refused


def states(times_ms: Sequence[int]) -> list[tuple[str, str, int, bytes]]:
    """Joint k at k rad/s, in another order and with a joint more."""
    names = ["finger", *reversed(JOINTS)]
    return [
        ("/joint_states", STATE, ms, joint_state(names, [9.0, *(axis * ms / 1000 for axis in range(6, 0, -1))]))
        for ms in times_ms
    ]


def gauges(name: str, times_ms: Sequence[int], mm: float) -> list[tuple[str, str, int, bytes]]:
    return [(f"/{name}", NUMBER, ms, number(mm + ms / 1000)) for ms in times_ms]


def read(data: bytes, by: Rig | None = None) -> tuple[list[str], np.ndarray[Any, Any], tuple[str, ...]]:
    text, doubts = table_of_bag(data, "lap.mcap", by or rig())
    names, *rows = csv.reader(io.StringIO(text.decode()))
    return names, np.array(rows, dtype=float), doubts


WHOLE = [*states(range(0, 1000, 10)), *gauges("g1", range(15, 900, 20), 0.1), *gauges("g2", range(3, 990, 20), -0.2)]


def test_rows_are_gauge_ones_and_the_rest_is_interpolated():
    names, rows, doubts = read(bag(*WHOLE))
    assert names == ["t_s", *(f"q{axis}_deg" for axis in range(1, 7)), "g1_mm", "g2_mm", "u_t_s", "u_lag_s"]
    ms = np.arange(15, 900, 20)
    assert rows[:, 0] == pytest.approx((ms - 15) / 1000)
    for axis in range(1, 7):
        assert rows[:, axis] == pytest.approx(np.degrees(axis * ms / 1000), abs=1e-9)
    assert rows[:, 7] == pytest.approx(0.1 + ms / 1000) and rows[:, 8] == pytest.approx(-0.2 + ms / 1000)
    assert len(doubts) == 1 and "reception" in doubts[0]


def test_rows_at_a_gap_of_the_joints_are_ignored_and_counted():
    gone = [one for one in WHOLE if not (one[0] == "/joint_states" and 300 < one[2] < 500)]
    _, rows, doubts = read(bag(*gone))
    assert not ((rows[:, 0] > 0.29) & (rows[:, 0] < 0.48)).any()
    assert "robot: 10 rows" in doubts[0]


def test_both_byte_orders_are_read():
    big = [("/joint_states", STATE, ms, joint_state(JOINTS, [0.5] * 6, ">")) for ms in range(0, 1000, 10)]
    _, rows, _ = read(bag(*big, *WHOLE[100:]))
    assert rows[:, 1:7] == pytest.approx(np.degrees(0.5))


@pytest.mark.parametrize(
    ("messages", "told"),
    [
        (WHOLE[100:], "/joint_states"),
        (
            [one for one in WHOLE if one[0] != "/g2"],
            r"of /g2 .*; its topics: /g1 \(std_msgs/msg/Float64\), /joint_states",
        ),
        ([("/joint_states", STATE, ms, joint_state(["a"], [1.0])) for ms in range(99)], "two usable"),
        ([("/g1", "std_msgs/msg/String", 1, b"")], "std_msgs/msg/String"),
        ([*states(range(0, 100, 10)), *gauges("g1", [500, 520], 0), *gauges("g2", [500, 520], 0)], "same time"),
        ([("/joint_states", STATE, 1, b"\0\1\0\0\xff\xff")], "two usable"),
    ],
)
def test_incomplete_bag_is_refused(messages, told):
    with pytest.raises(FileError, match=told):
        read(bag(*messages))


@pytest.mark.parametrize("bad", [b"", b"\0\1\0\0", b"\0\1\0\0" + b"\xff" * 50, joint_state(["a"], [1.0])])
def test_a_message_that_cannot_be_used_is_left_out_and_counted(bad):
    _, rows, doubts = read(bag(*WHOLE, ("/joint_states", STATE, 1200, bad)))
    assert len(rows) == 45 and "/joint_states: 1 of 101 messages" in doubts[0]


def test_a_topic_in_another_encoding_is_not_taken_for_cdr():
    out = io.BytesIO()
    writer = Writer(out)
    writer.start()
    channel = writer.register_channel("/joint_states", "json", writer.register_schema(STATE, "jsonschema", b""))
    writer.add_message(channel, BEGIN_NS, b'{"position": [0, 0, 0, 0, 0, 0]}', BEGIN_NS)
    writer.finish()
    with refused("table.invalid", "contains fewer than two usable messages"):
        read(out.getvalue())


def test_bag_of_a_killed_recorder_names_the_repair():
    with refused("table.invalid", "bytes at the end are missing"):
        read(bag(*WHOLE)[:-30])


def test_rig_without_ros_names_the_missing_key():
    with refused("table.invalid", "file does not name the joints"):
        read(bag(*WHOLE), parse((SHIPPED / "ur10e-cell.yaml").read_text(), "ur10e.yaml"))


def test_missing_library_names_the_package(monkeypatch):
    bags.message_decoder.cache_clear()
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    with pytest.raises(CellError) as error:
        read(bag(*WHOLE))
    assert error.value.remedy == to_install("rosbags")


@pytest.mark.parametrize("length", [0x7FFFFFFF, 0xFFFFFFFC])
@pytest.mark.parametrize("at", [12, 24])
def test_message_with_an_impossible_length_is_counted_without_allocating_it(at, length):
    """Lengths of the frame name and of the list of joints."""
    message = joint_state(JOINTS, [0.0] * 6)
    changed = message[:at] + struct.pack("<I", length) + message[at + 4 :]
    _, rows, doubts = read(bag(*WHOLE, ("/joint_states", STATE, 1200, changed)))
    assert len(rows) == 45 and "/joint_states: 1 of 101 messages" in doubts[0]


@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.LZ4])
def test_bag_larger_than_memory_is_not_unpacked(compression, monkeypatch):
    """A chunk may also state less than its frame unpacks to."""
    monkeypatch.setattr(bags, "_MOST_UNPACKED", 1_000_000)  # private: 2 GB would take a minute
    data = bag(*WHOLE, ("/camera", "sensor_msgs/msg/Image", 5, bytes(2_000_000)), compression=compression)
    lying = data.replace(struct.pack("<Q", _largest_chunk(data)), struct.pack("<Q", 10), 1)
    assert len(data) < 200_000 and lying != data
    for one in (data, lying):
        with refused("file.too_large", "expands to more than"):
            read(one)
    assert len(read(bag(*WHOLE, compression=compression))[1]) > 10


def _largest_chunk(data: bytes) -> int:
    records = StreamReader(io.BytesIO(data), emit_chunks=True).records
    return max(one.uncompressed_size for one in records if isinstance(one, Chunk))

import io
import re
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from mcap.data_stream import RecordBuilder
from mcap.records import Chunk, ChunkIndex
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

from analysis import Quantity, evaluate, simulate
from analysis.apps.interchange.ros_bag import table_of_bag
from analysis.intake.read import parse_csv
from analysis.robot.kinematics.arm import Array
from analysis.runs.loading import Measured, measured_of
from analysis.runs.tables import CircleTable
from daq.store import table_run
from rigs.errors import FileError
from tests.support.bags import BEGIN_NS, JOINTS, MS, NUMBER, STATE, bag, joint_state, number, rig

Messages = list[tuple[str, str, float, bytes]]


@pytest.fixture(scope="module")
def lap():
    """A lap with the effects of the shipped cell, without noise."""
    return simulate("ur10e", "yaw", "acw", seed=None, effects="ur10e")


def _messages(lap: Measured, late_ms: Array | None = None, stamped: bool = False) -> Messages:
    """The lap as messages; late_ms (n,): by how much those of the joints are late."""
    table = lap.table
    assert isinstance(table, CircleTable)
    ms = table.t_s * 1e3
    came = ms if late_ms is None else np.maximum.accumulate(ms + late_ms)
    stamps = [BEGIN_NS + round(one * MS) if stamped else 0 for one in ms.tolist()]
    rows = zip(table.q.tolist(), came.tolist(), stamps, strict=True)
    found: Messages = [("/joint_states", STATE, at, joint_state(JOINTS, q, stamp_ns=stamp)) for q, at, stamp in rows]
    for name, column in (("/g1", 0), ("/g2", 1)):
        found += [(name, NUMBER, at, number(mm)) for at, mm in zip(ms, table.g_mm[:, column].tolist(), strict=True)]
    return sorted(found, key=lambda one: one[2])


def _imported(lap: Measured, data: bytes) -> tuple[Measured, tuple[str, ...]]:
    text, doubts = table_of_bag(data, "lap.mcap", rig())
    manifest = lap.run.manifest
    run = table_run(
        Path("lap"),
        parse_csv(text, "lap.mcap", "yaw", lap.rig, "acw"),
        test="yaw",
        direction="acw",
        rig_name=manifest.rig_name,
        rig_text=manifest.rig_text,
        operator="",
        source="lap.mcap",
        source_sha256="0" * 64,
    )
    return measured_of(run), doubts


def _shift(run: Measured) -> Quantity:
    return evaluate(run).figures["shift_deg"]


@pytest.mark.parametrize("stamped", [False, True])
def test_late_joints_are_corrected_by_pace_or_stamps(lap, stamped):
    late_ms = np.random.default_rng(1).uniform(0, 30, len(lap.table.q))
    run, _ = _imported(lap, bag(*_messages(lap, late_ms, stamped)))
    truth, found = _shift(lap), _shift(run)
    assert abs(found.value - truth.value) < 0.02
    assert run.u_lag_s > 0.005 and found.u > 0.1  # a cycle of 20 ms, in which a controller latches at some time


def test_uncorrected_delay_of_joints_is_in_u(lap):
    """A loop without a crystal: 0.03 s of lateness turned the curve by 0.32° with u 0.017°."""
    rng = np.random.default_rng(2)
    table = lap.table
    assert isinstance(table, CircleTable)
    kept = np.sort(rng.choice(len(table.t_s), len(table.t_s) * 2 // 3, replace=False))
    joints = [(k, table.t_s[k] * 1e3 + late) for k, late in zip(kept, rng.uniform(0, 30, len(kept)), strict=True)]
    came = np.maximum.accumulate([at for _, at in joints])
    states: Messages = [
        ("/joint_states", STATE, float(at), joint_state(JOINTS, table.q[k].tolist(), stamp_ns=0))
        for (k, _), at in zip(joints, came, strict=True)
    ]
    gauges = [one for one in _messages(lap) if one[0] != "/joint_states"]
    run, _ = _imported(lap, bag(*sorted([*states, *gauges], key=lambda one: one[2])))
    truth, found = _shift(lap), _shift(run)
    assert isinstance(run.table, CircleTable) and run.table.u_t_s is not None
    assert 0.004 < np.sqrt(np.mean(run.table.u_t_s**2)) < 0.03
    assert 0.2 < abs(found.value - truth.value) < 2 * found.u


def test_newest_stamp_of_two_publishers_wins_with_a_doubt(lap):
    sent = _messages(lap, stamped=True)
    states = [one for one in sent if one[0] == "/joint_states"]
    again: Messages = [
        (topic, kind, later[2] + 3, data) for (topic, kind, _, data), later in zip(states, states[200:], strict=False)
    ]
    both = sorted([*sent, *again], key=lambda one: one[2])
    run, doubts = _imported(lap, bag(*both))
    count, total = len(again), len(states) + len(again)
    assert any(f"/joint_states: {count} of {total} messages" in one for one in doubts)
    assert any("second publisher" in one for one in doubts)
    for name, figure in evaluate(lap).figures.items():
        assert evaluate(run).figures[name].value == pytest.approx(figure.value, abs=0.01), name


def test_uneven_header_clock_is_replaced_by_even_reception_times(lap):
    """The header of each message had a stamp of up to 30 ms before or after; the doubt was a second publisher."""
    rng = np.random.default_rng(3)
    table = lap.table
    assert isinstance(table, CircleTable)
    stamps = [BEGIN_NS + round(at * MS) for at in (table.t_s * 1e3 + rng.uniform(-30, 30, len(table.t_s))).tolist()]
    states: Messages = [
        ("/joint_states", STATE, at, joint_state(JOINTS, q, stamp_ns=stamp))
        for at, q, stamp in zip((table.t_s * 1e3).tolist(), table.q.tolist(), stamps, strict=True)
    ]
    gauges = [one for one in _messages(lap) if one[0] != "/joint_states"]
    run, doubts = _imported(lap, bag(*sorted([*states, *gauges], key=lambda one: one[2])))
    assert any(doubt.startswith("/joint_states: the clock") for doubt in doubts)
    assert not any("second publisher" in doubt for doubt in doubts)
    for name, figure in evaluate(lap).figures.items():
        assert evaluate(run).figures[name].value == pytest.approx(figure.value, abs=0.01), name


def test_one_stamp_from_the_future_does_not_make_all_others_old(lap):
    sent = _messages(lap, stamped=True)
    place = next(k for k, one in enumerate(sent) if one[0] == "/joint_states" and one[2] > 5000)
    odd = joint_state(JOINTS, [0.0] * 6, stamp_ns=BEGIN_NS + 3600 * 10**9)
    sent[place] = (*sent[place][:3], odd)
    _, doubts = _imported(lap, bag(*sent))
    assert any(re.search(r"^/joint_states: 1 of \d+ messages", one) for one in doubts)


@pytest.mark.parametrize("compression", list(CompressionType))
def test_flipped_bit_is_refused(compression):
    data = bytearray(bag(*_small(), compression=compression))
    records = StreamReader(io.BytesIO(data), emit_chunks=True).records
    chunk = next(one for one in records if isinstance(one, Chunk))
    at = bytes(data).index(chunk.data) + len(chunk.data) // 2
    whole, told = table_of_bag(bytes(data), "lap.mcap", rig()), 0
    for bit in range(8):
        changed = bytes(data[:at]) + bytes([data[at] ^ 1 << bit]) + bytes(data[at + 1 :])
        try:  # a bit of a compressor's own, such as which of two like places it copies, may change nothing
            assert table_of_bag(changed, "lap.mcap", rig()) == whole
        except FileError as error:
            told += "damaged" in str(error)
    assert told >= 6


def test_missing_chunk_is_refused():
    """An opcode with a changed bit makes a record that no reader knows, and skips."""
    data = bag(*_small())
    records = StreamReader(io.BytesIO(data), emit_chunks=True).records
    chunk = next(one for one in records if isinstance(one, Chunk))
    at = data.index(chunk.data)
    head = data.rindex(b"\x06", 0, at - 20)
    with pytest.raises(FileError, match="damaged"):
        table_of_bag(data[:head] + b"\x86" + data[head + 1 :], "lap.mcap", rig())


def test_a_bag_without_checksums_is_a_doubt():
    out = io.BytesIO()
    writer = Writer(out, enable_crcs=False, use_chunking=False)
    writer.start(profile="ros2")
    channels: dict[str, int] = {}
    for topic, kind, ms, data in _small():
        if topic not in channels:
            channels[topic] = writer.register_channel(topic, "cdr", writer.register_schema(kind, "ros2msg", b""))
        at = BEGIN_NS + round(ms * MS)
        writer.add_message(channels[topic], at, data, at)
    writer.finish()
    _, doubts = table_of_bag(out.getvalue(), "lap.mcap", rig())
    assert any("checksums" in one for one in doubts)
    assert not any("checksums" in one for one in table_of_bag(bag(*_small()), "lap.mcap", rig())[1])


def test_an_index_that_names_one_chunk_often_unpacks_it_once():
    data = bag(*_small(), ("/camera", "sensor_msgs/msg/Image", 500.0, bytes(8_000_000)))
    records = list(StreamReader(io.BytesIO(data), emit_chunks=True).records)
    index = max((one for one in records if isinstance(one, ChunkIndex)), key=lambda one: one.uncompressed_size)
    written = RecordBuilder()
    index.write(written)
    again = written.end()
    at = data.index(again)
    bomb = data[:at] + 500 * again + data[at:]
    tracemalloc.start()
    try:
        text, _ = table_of_bag(bomb, "lap.mcap", rig())
        assert tracemalloc.get_traced_memory()[1] < 60_000_000
    finally:
        tracemalloc.stop()
    assert text == table_of_bag(data, "lap.mcap", rig())[0]


def _small() -> Messages:
    states: Messages = [("/joint_states", STATE, ms, joint_state(JOINTS, [ms / 1e3] * 6)) for ms in range(0, 1000, 10)]
    gauges: Messages = [(name, NUMBER, ms, number(ms / 1e3)) for name in ("/g1", "/g2") for ms in range(5, 990, 20)]
    return sorted([*states, *gauges], key=lambda one: one[2])

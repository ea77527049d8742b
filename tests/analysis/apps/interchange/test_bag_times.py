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
from daq.store import table_run
from rigs.errors import FileError
from tests.support.bags import BEGIN_NS, JOINTS, MS, NUMBER, STATE, bag, joint_state, number, rig

Messages = list[tuple[str, str, float, bytes]]


@pytest.fixture(scope="module")
def lap():
    """A lap with the effects of the shipped cell, without noise."""
    return simulate("ur10e-cell", "yaw", "acw", seed=None, effects="ur10e-cell")


@pytest.fixture(scope="module")
def ms(lap):
    """Times of the rows of the lap."""
    return lap.table.t_s * 1e3


def _messages(
    lap: Measured, came_ms: Array | None = None, stamps_ms: Array | None = None, rows: Array | slice = slice(None)
) -> Messages:
    """The lap as messages. came_ms: times at which those of the joints arrive; stamps_ms: those of their headers;
    rows: those of the joints that are sent."""
    ms = lap.table.t_s * 1e3
    came = ms[rows] if came_ms is None else np.maximum.accumulate(came_ms)
    stamps = [0] * len(came) if stamps_ms is None else [BEGIN_NS + round(at * MS) for at in stamps_ms.tolist()]
    sent = zip(lap.table.q[rows].tolist(), came.tolist(), stamps, strict=True)
    found = [("/joint_states", STATE, at, joint_state(JOINTS, q, stamp_ns=stamp)) for q, at, stamp in sent]
    for name, column in (("/g1", 0), ("/g2", 1)):
        found += [(name, NUMBER, at, number(mm)) for at, mm in zip(ms, lap.table.g_mm[:, column].tolist(), strict=True)]
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
def test_late_joints_are_corrected_by_pace_or_stamps(lap, ms, stamped):
    late_ms = np.random.default_rng(1).uniform(0, 30, len(ms))
    run, _ = _imported(lap, bag(*_messages(lap, ms + late_ms, ms if stamped else None)))
    truth, found = _shift(lap), _shift(run)
    assert abs(found.value - truth.value) < 0.02
    assert run.u_lag_s > 0.005 and found.u > 0.1  # a cycle of 20 ms, in which a controller latches at some time


def test_uncorrected_delay_of_joints_is_in_u(lap, ms):
    """A loop without a crystal: 0.03 s of lateness turned the curve by 0.32° with u 0.017°."""
    rng = np.random.default_rng(2)
    kept = np.sort(rng.choice(len(ms), len(ms) * 2 // 3, replace=False))
    run, _ = _imported(lap, bag(*_messages(lap, ms[kept] + rng.uniform(0, 30, len(kept)), rows=kept)))
    truth, found = _shift(lap), _shift(run)
    assert 0.004 < np.sqrt(np.mean(run.table.u_t_s**2)) < 0.03
    assert 0.2 < abs(found.value - truth.value) < 2 * found.u


def _require_figures_of(lap: Measured, run: Measured) -> None:
    for name, figure in evaluate(lap).figures.items():
        assert evaluate(run).figures[name].value == pytest.approx(figure.value, abs=0.01), name


def test_newest_stamp_of_two_publishers_wins_with_a_doubt(lap, ms):
    sent = _messages(lap, stamps_ms=ms)
    states = [one for one in sent if one[0] == "/joint_states"]
    again = [
        (topic, kind, later[2] + 3, data) for (topic, kind, _, data), later in zip(states, states[200:], strict=False)
    ]
    run, doubts = _imported(lap, bag(*sorted([*sent, *again], key=lambda one: one[2])))
    count, total = len(again), len(states) + len(again)
    assert any(f"/joint_states: {count} of {total} messages" in one for one in doubts)
    assert any("second publisher" in one for one in doubts)
    _require_figures_of(lap, run)


def test_uneven_header_clock_is_replaced_by_even_reception_times(lap, ms):
    """The header of each message had a stamp of up to 30 ms before or after; the doubt was a second publisher."""
    uneven_ms = ms + np.random.default_rng(3).uniform(-30, 30, len(ms))
    run, doubts = _imported(lap, bag(*_messages(lap, stamps_ms=uneven_ms)))
    assert any(doubt.startswith("/joint_states: the clock") for doubt in doubts)
    assert not any("second publisher" in doubt for doubt in doubts)
    _require_figures_of(lap, run)


def test_one_stamp_from_the_future_does_not_make_all_others_old(lap, ms):
    sent = _messages(lap, stamps_ms=ms)
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
    channels = {}
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
    states = [("/joint_states", STATE, ms, joint_state(JOINTS, [ms / 1e3] * 6)) for ms in range(0, 1000, 10)]
    gauges = [(name, NUMBER, ms, number(ms / 1e3)) for name in ("/g1", "/g2") for ms in range(5, 990, 20)]
    return sorted([*states, *gauges], key=lambda one: one[2])

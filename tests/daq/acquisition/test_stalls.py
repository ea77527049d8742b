import gc
import re
import sys
import time
from types import SimpleNamespace
from typing import Any

import pytest

from daq.acquisition.host_clock import StallWatch
from daq.acquisition.reader import StreamReader, keep_stamps_prompt
from daq.acquisition.stream_buffer import STALL_NS, StreamBuffer, faults_of, samples_of
from daq.protocol.conversation import ConversationStep, Fault, FaultKind, Sample, SampleBlock
from daq.store import read_run, verify
from daq.wire.links import LinkLost
from tests.support.simulated_bench import SimulatedBench

S = 1_000_000_000


@pytest.fixture
def buffer():
    return StreamBuffer("g1", ("g1_mm",))


def test_a_stall_does_not_hide_why_an_instrument_gives_no_readings(buffer):
    def stand_still() -> None:
        buffer.beat()
        buffer.heartbeat_ns -= S
        buffer.beat()

    buffer.deliver([Fault(FaultKind.DEVICE_ERROR, 0, "ERR0: sensor error")])
    stand_still()
    assert buffer.state().last_fault == "ERR0: sensor error"
    buffer.deliver([Sample((1.0,), 0, 0, S, 9)])
    stand_still()
    assert "run for 1.0 s" in buffer.state().last_fault


def test_stalled_reader_is_reported_once_with_its_length(buffer):
    buffer.beat()
    assert buffer.drain() == []  # it has just begun
    buffer.heartbeat_ns -= 3 * S
    buffer.beat()
    buffer.beat()
    (fault,) = buffer.drain()
    assert fault.kind is FaultKind.STALLED and fault.count == 1
    assert "run for 3.0 s" in fault.detail and buffer.state().counters == {"stalled": 1}


def test_a_port_that_takes_long_to_open_is_no_stall(buffer):
    buffer.beat()
    with buffer.opening():
        buffer.heartbeat_ns -= 3 * S
    assert buffer.drain() == []


def test_sleeping_thread_detects_a_stall_of_the_process():
    watch = StallWatch()
    watch.note(0, STALL_NS)
    assert watch.take() == []
    watch.note(0, 5 * S)
    (fault,) = watch.take()
    assert "run for 5.0 s" in fault.detail and fault.at_ns == 5 * S
    assert watch.take() == []


def test_recent_sleep_is_one_stall(
    monkeypatch,
):
    watch = StallWatch()
    watch.start()
    later = SimpleNamespace(now_ns=lambda: time.monotonic_ns() + 5 * S)
    with monkeypatch.context() as patched:
        patched.setattr("daq.acquisition.host_clock.clock", later)
        assert len(watch.take()) == 1
        assert watch.take() == []
    watch.stop()
    watch.join()
    later.now_ns = lambda: time.monotonic_ns() + 10 * S
    monkeypatch.setattr("daq.acquisition.host_clock.clock", later)
    assert watch.take() == []


def test_delivery_ending_with_a_fault_counts_for_the_rate(buffer):
    now_ns = time.monotonic_ns()
    for round_ in range(11):
        at_ns = now_ns - (10 - round_) * S // 10
        sample, fault = Sample((0.0,), -1, at_ns, at_ns, 3), Fault(FaultKind.GARBLED, at_ns, "cut")
        buffer.deliver([*[sample] * 400, fault])
        buffer.deliver([fault])
    state = buffer.state()
    assert state.rate_hz == pytest.approx(4000) and state.waiting == 11 * 402


def test_a_block_that_finds_no_room_is_counted_sample_by_sample(buffer, monkeypatch):
    # private: the room is minutes of readings
    monkeypatch.setattr("daq.acquisition.stream_buffer._ROOM", 500)
    block = SampleBlock.of([Sample((float(k),), -1, k, k, 3) for k in range(200)])
    for _ in range(4):
        buffer.deliver([block])
    items = buffer.drain()
    (fault,) = faults_of(items)
    assert len(samples_of(items)) == 400 and (fault.kind, fault.count) == (FaultKind.DROPPED, 400)
    assert buffer.state().counters == {"samples": 800, "dropped": 400} and buffer.state().last == {"g1_mm": 199.0}


def test_faults_that_find_no_room_keep_their_kind_and_count(buffer, monkeypatch):
    # private: the room is minutes of readings
    monkeypatch.setattr("daq.acquisition.stream_buffer._ROOM", 2)
    buffer.deliver([Sample((float(k),), -1, k, k, 3) for k in range(3)])
    buffer.deliver([Fault(FaultKind.GARBLED, 5, "noise", 7), Fault(FaultKind.GARBLED, 6, "noise", 2)])
    found = faults_of(buffer.drain())
    assert [(fault.kind, fault.count) for fault in found] == [(FaultKind.DROPPED, 1), (FaultKind.GARBLED, 9)]
    assert all("dropped while" in fault.detail for fault in found)
    assert buffer.state().counters == {"samples": 3, "dropped": 1, "garbled": 9}
    assert buffer.drain() == []


def test_flooding_stream_leaves_time_to_the_others(monkeypatch):
    used_s, now_s, paused = 0.0, 1000.0, []
    rounds = [b"flood", b"flood", b"one", b"fast", b"fast"]

    class Endless:
        def read(self, timeout_s: float) -> bytes:
            if not rounds:
                raise LinkLost("over")
            return rounds.pop(0)

        def write(self, data: bytes) -> None: ...
        def close(self) -> None: ...
        def note_items(self, items: object) -> None: ...
        def take_ignored(self) -> None: ...

    class Costly:
        def connected(self, now_ns: int) -> ConversationStep:
            return ConversationStep()

        def received(self, data: bytes, now_ns: int) -> ConversationStep:
            nonlocal used_s, now_s
            took_s = {b"flood": 0.05, b"fast": 0.015}.get(data, 0.00003)
            used_s, now_s = used_s + took_s, now_s + (0.04 if data == b"fast" else took_s)
            return ConversationStep()

        def handle_link_loss(self, now_ns: int) -> tuple[()]:
            return ()

    clock = SimpleNamespace(
        worked_s=lambda: used_s, sleep=paused.append, now_ns=lambda: round(1e9 * now_s), now_s=lambda: now_s
    )
    stream: Any = SimpleNamespace(name="robot", port="tcp://x:1", host=Costly)
    link: Any = Endless()
    reader = StreamReader(stream, StreamBuffer("robot", ()), link)
    # private _stop_asked, _read: what the thread does until its link is lost, with the pauses it asks for
    monkeypatch.setattr(reader, "_stop_asked", SimpleNamespace(is_set=lambda: False, wait=lambda s: True))
    for module in ("daq.acquisition.reader", "daq.wire.conversation_loop"):
        monkeypatch.setattr(f"{module}.clock", clock)
    reader._read(link)
    assert paused == [pytest.approx(0.05), pytest.approx(0.05)]


def test_stalled_daemon_reports_it_in_the_run(tmp_path):
    with SimulatedBench(tmp_path) as bench:
        bench.start().all_reading()
        path = bench.record()
        bench.recorded(20)
        bench.time.stall(1.5)
        before = bench.until(lambda state: state["host"].get("stalled"))["samples"]
        bench.until(lambda state: all(count > before[name] + 3 for name, count in state["samples"].items()))
        bench.stop()
    found = [fault for fault in read_run(path).faults if fault["kind"] == "stalled"]
    assert sorted(fault["stream"] for fault in found) == ["g1", "g2", "host", "robot"]
    for fault in found:
        told = re.search(r"run for ([0-9.]+) s", fault["detail"])
        assert told and 1.5 <= float(told[1]) <= 1.7  # a reader has waited for at most 0.2 s before
    assert verify(path) == []


@pytest.fixture(autouse=True)
def _as_before():
    interval_s = sys.getswitchinterval()
    yield
    sys.setswitchinterval(interval_s)
    gc.unfreeze()


def test_collector_ignores_existing_objects_and_threads_switch_sooner():
    before_s, there = 0.005, [[]]
    sys.setswitchinterval(before_s)  # Python's own; a daemon that ran in this process has changed it
    keep_stamps_prompt()
    assert sys.getswitchinterval() < before_s / 5
    assert not any(found is there for found in gc.get_objects())

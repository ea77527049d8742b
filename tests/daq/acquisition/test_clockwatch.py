import pytest

import daq.recording.warnings
import daq.store.manifest
import daq.store.writer
from daq.acquisition.host_clock import HOST, ClockReadings, HostClockMonitor
from daq.acquisition.stream_buffer import StreamBuffer
from daq.protocol.conversation import Sample
from daq.recording.active_run import RunLabel
from daq.recording.machine import RecordingRequest
from daq.store import read_run
from daq.store.ledger import Clock
from tests.support.recorders import recorder_of

S = 1_000_000_000
START = ClockReadings(100 * S, 1_800_000_000 * S, 150 * S)


def later(by: ClockReadings, s: float, *, stepped_s: float = 0.0, slept_s: float = 0.0) -> ClockReadings:
    passed, slept = round(s * S), round(slept_s * S)
    wall_ns = by.wall_ns + passed + slept + round(stepped_s * S)
    return ClockReadings(by.monotonic_ns + passed, wall_ns, by.boot_ns + passed + slept)


def test_quiet_clocks_tell_nothing():
    watch, now = HostClockMonitor(START), START
    for _ in range(100):
        now = later(now, 0.5, stepped_s=2e-6)
        assert watch.check(now) == []


@pytest.mark.parametrize("stepped_s", [3.25, -7200.0, 0.011])
def test_step_of_the_wall_clock_is_reported_once(stepped_s):
    watch = HostClockMonitor(START)
    now = later(START, 0.5, stepped_s=stepped_s)
    (fault,) = watch.check(now)
    assert (fault.kind, fault.at_ns) == ("clock", now.monotonic_ns)
    assert f"set by {stepped_s:+.3f} s, from 2027-01-15T08:00:00.500+00:00 to 2027-01-1" in fault.detail
    assert watch.check(later(now, 0.5)) == []


def test_small_steps_add_up():
    watch, now, told = HostClockMonitor(START), START, 0
    for _ in range(12):
        now = later(now, 0.5, stepped_s=0.004)
        told += len(watch.check(now))
    assert told == 4


def test_suspension_is_reported_and_no_step():
    (fault,) = HostClockMonitor(START).check(later(START, 0.5, slept_s=61.0))
    assert "suspended for 61.0 s" in fault.detail
    both = HostClockMonitor(START).check(later(START, 0.5, slept_s=61.0, stepped_s=-2.0))
    assert [
        word in fault.detail for word, fault in zip(("suspended for 61.0 s", "set by -2.000 s"), both, strict=True)
    ] == [True] * 2


def test_run_keeps_the_step_and_the_right_time_after_it(tmp_path, monkeypatch):
    now = [START]
    monkeypatch.setattr(daq.recording.warnings, "read_clocks", lambda: now[0])
    anchor = Clock(monotonic_ns=now[0].monotonic_ns, unix_ns=now[0].wall_ns, bracket_ns=0)
    for module in (daq.store.manifest, daq.store.writer):
        monkeypatch.setattr(module, "clock_now", lambda: anchor)
    buffer = StreamBuffer("g1", ("g1_mm",))

    recorder = recorder_of(tmp_path, {"g1": buffer})
    monkeypatch.setattr(daq.recording.recorder, "require_readings", lambda buffers, test: None)
    path = recorder.start_run(RecordingRequest(RunLabel(name="a", test="radial"))).result()
    now[0] = later(START, 10.0, stepped_s=3600.0)
    anchor = Clock(monotonic_ns=now[0].monotonic_ns, unix_ns=now[0].wall_ns, bracket_ns=0)
    buffer.deliver([Sample((1.0,), -1, now[0].monotonic_ns, now[0].monotonic_ns, 8)])
    ended = recorder.stop_run().result()
    assert ended.counters == {"g1": {"samples": 1}, HOST: {"clock": 1}} and recorder.host.counts == {"clock": 1}
    run = read_run(path)
    assert [(fault["stream"], fault["kind"], fault["at_ns"]) for fault in run.faults] == [
        (HOST, "clock", now[0].monotonic_ns)
    ]
    assert run.manifest.anchors == (anchor,)
    assert run.manifest.wall_ns(START.monotonic_ns + 5 * S) == START.wall_ns + 5 * S
    assert run.manifest.wall_ns(START.monotonic_ns + 15 * S) == START.wall_ns + 3615 * S

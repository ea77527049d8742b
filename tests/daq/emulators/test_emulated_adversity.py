import random
from itertools import pairwise

from hypothesis import given, settings
from hypothesis import strategies as st

import daq.feedback
from daq.acquisition.stream_buffer import samples_of
from daq.emulators.emulated_cell import Adversity
from daq.emulators.instruments import emulated
from daq.emulators.pty_line import LatencyTimer, PtyLine
from daq.emulators.timed import OwnClock, OwnCycle, Unsteady, timed_read
from daq.protocol.conversation import Item, Sample
from daq.wire.conversation_loop import run_conversation
from daq.wire.links import open_link
from rigs.load import load
from rigs.schema.feedback import URRTDE
from rigs.schema.links import Line
from rigs.schema.probe import Timing

MS = 1_000_000


def test_bytes_wait_for_the_next_beat_of_the_timer():
    timer = LatencyTimer(16, 0)
    timer.add(b"a", 5 * MS)
    timer.add(b"b", 9 * MS)
    assert timer.due_ns == 16 * MS and timer.take(15 * MS) == b""
    assert timer.take(17 * MS) == b"ab" and timer.due_ns is None
    timer.add(b"c", 70 * MS)
    assert timer.due_ns == 80 * MS  # an idle adapter's timer runs on from when it was due, not from when it was read


def test_a_full_packet_goes_at_once_and_the_timer_begins_again():
    timer = LatencyTimer(16, 0)
    timer.add(b"x" * 62, 3 * MS)
    assert timer.due_ns == 3 * MS and timer.take(3 * MS) == b"x" * 62
    timer.add(b"y", 10 * MS)
    assert timer.due_ns == 19 * MS


@settings(max_examples=50)
@given(st.lists(st.tuples(st.integers(0, 30 * MS), st.binary(min_size=1, max_size=70)), max_size=20))
def test_no_byte_is_lost_or_held_longer_than_the_latency(pieces):
    timer, now_ns, out = LatencyTimer(16, 0), 0, b""
    for pause_ns, piece in pieces:
        now_ns += pause_ns
        out += timer.take(now_ns)
        timer.add(piece, now_ns)
        assert timer.due_ns <= now_ns + 16 * MS
    assert out + timer.take(now_ns + 16 * MS) == b"".join(piece for _, piece in pieces)


def test_a_line_with_a_timer_gives_its_bytes_together():
    """At 4800 baud six characters take 14 ms: without a timer they come one by one."""
    line = Line(baud=4800, bits=7, parity="E", stop=2)
    pty = PtyLine(line, latency_ms=400)
    link = open_link("test", pty.port, line)
    try:
        pty.write(b"+1.23\r")
        pty.read(0.5)  # what an idle instrument does, while the adapter goes on
        assert link.read(5) == b"+1.23\r"
    finally:
        link.close()
        pty.close()


def test_an_own_cycle_shows_its_last_reading_until_the_next_tick():
    shown = OwnCycle(lambda now_ns: [float(now_ns)], 100 * MS, 1, Unsteady(), random.Random(1))
    seen = [(now_ms * MS, shown(now_ms * MS)[0]) for now_ms in range(0, 1000, 7)]
    ages = [now_ns - at_ns for now_ns, at_ns in seen]
    assert min(ages) >= 0 and 90 * MS < max(ages) <= 100 * MS
    ticks = sorted({at_ns for _, at_ns in seen})
    assert len(ticks) == 11 and {round(b - a) for a, b in pairwise(ticks)} <= {100 * MS - 1, 100 * MS, 100 * MS + 1}


def test_an_unsteady_cycle_drifts_jitters_and_leaves_ticks_out():
    unsteady = Unsteady(ppm=500, jitter=0.05, missed=0.1)
    shown = OwnCycle(lambda now_ns: [now_ns / MS], 100 * MS, 1, unsteady, random.Random(1))
    ticks = sorted({shown(now_ms * MS)[0] for now_ms in range(0, 60_000, 10)})
    steps = [b - a for a, b in pairwise(ticks)]
    assert 20 < sum(step > 150 for step in steps) < 110
    assert 1 < max(abs(step - 100) for step in steps if step < 150) < 11


def test_filter_delays_the_mean_by_its_group_delay():
    chance = random.Random(1)
    for timing in (Timing(latch="own_cycle", cycle_ms=10, filter_ms=40), Timing(latch="on_request", filter_ms=40)):
        shown = timed_read(lambda now_ns: [float(now_ns)], timing, Unsteady(), chance)
        late = [now_ms * MS - shown(now_ms * MS)[0] for now_ms in range(0, 2000, 3)][50:]
        assert min(late) >= 40 * MS and max(late) <= 50 * MS


def test_a_controller_on_its_own_clock_stamps_and_paces_by_it():
    """1 % fast, so that it shows: 101 periods of 2 ms in 0.2 s of the host's, each read at the host's time."""
    read_ns: list[int] = []
    feedback = URRTDE(interface="ur_rtde", port="tcp://127.0.0.1:30004")

    def read(now_ns: int) -> list[float]:
        read_ns.append(now_ns)
        return [0.0] * 6

    device = OwnClock(lambda of: daq.feedback.device(feedback, of), read, ppm=10_000)
    host = daq.feedback.host(feedback)
    device.connected(0)
    step, items = host.connected(0), list[Item]()
    while step.send:
        answer = device.received(step.send, 0)
        step = host.received(answer.send, 0)
    while answer.wake_ns is not None and answer.wake_ns < 200 * MS + 10:
        answer = device.tick(answer.wake_ns)
        items += host.received(answer.send, 0).items
    clock_s = [item.device_time_s for item in samples_of(items)]
    assert device.sent == len(clock_s) == 102
    assert {round((b - a) * 1e9) for a, b in pairwise(clock_s)} == {2 * MS}
    assert {round((b - a) / 1e3) for a, b in pairwise(read_ns)} == {1980}


def test_a_cell_can_be_adverse():
    class Still:
        def gauge_mm(self, name: str, now_ns: int) -> float:
            return 0.0

        def joints_deg(self, now_ns: int) -> list[float]:
            return [now_ns * 1e-9] * 6

    cell = emulated(load("ur10e-cell")[0], Still(), adversity=Adversity(latency_ms=16, jitter_ms=5, drift_ppm=30))
    cell.start()
    samples: list[Sample] = []
    link = open_link("robot", cell.ports["feedback"], Line(baud=9600, bits=8, parity="N", stop=1))
    try:
        feedback = URRTDE(interface="ur_rtde", port="tcp://127.0.0.1:30004")
        run_conversation(
            link,
            daq.feedback.host(feedback),
            lambda items: samples.extend(item for item in items if isinstance(item, Sample)),
            lambda: len(samples) > 150,
        )
    finally:
        link.close()
        cell.stop()
    late_ms = [(sample.last_byte_ns - sample.values[0] * 1e9) / MS for sample in samples]
    assert sum(late_ms) / len(late_ms) > 4
    assert {round((b.device_time_s - a.device_time_s) * 1e6) for a, b in pairwise(samples)} == {2000}

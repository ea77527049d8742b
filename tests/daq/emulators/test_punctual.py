import random
import time
from itertools import pairwise

from daq import gauges
from daq.emulators.pty_line import PtyLine
from daq.emulators.timed import STEADY, Punctual, timed_device
from daq.protocol.conversation import Device
from rigs.schema.links import Line
from rigs.schema.probe import Timing
from tests.support.stamp_cells import CONTINUOUS, GAUGES

MS = 1_000_000
SYLVAC = GAUGES[CONTINUOUS]


class _Counted:
    def __init__(self, character_ns: int) -> None:
        self.character_ns = character_ns
        self.free_ns = 0
        self.out_ns: list[int] = []

    def set_out(self, at_ns: int) -> None:
        self.out_ns.append(max(self.free_ns, at_ns))

    def write(self, data: bytes) -> None:
        self.free_ns = self.out_ns[-1] + len(data) * self.character_ns


def _messages(device: Device, read_ns: list[int], count: int) -> list[int]:
    """When so many messages set out, of a device that is woken up to 5 ms late, and once 200 ms."""
    chance = random.Random(1)
    line = _Counted(SYLVAC.line.character_ns)
    punctual = Punctual(device, line)
    punctual.connected(0)
    step = punctual.received(b"OUT1\r", 10 * MS)
    while len(line.out_ns) < count:
        late_ns = 200 * MS if len(line.out_ns) == 50 else chance.randrange(5 * MS)
        step = punctual.tick(max(step.wake_ns, line.free_ns) + late_ns)
        if step.send:
            line.write(step.send)
    assert read_ns == line.out_ns  # a reading is that of the time at which its message sets out
    return line.out_ns


def test_continuous_gauge_has_the_pace_of_its_line():
    read_ns: list[int] = []
    device = gauges.device([SYLVAC], lambda now_ns: [read_ns.append(now_ns) or 1.0])
    steps = {b - a for a, b in pairwise(_messages(device, read_ns, 100))}
    assert steps == {len("+1.0000\r") * SYLVAC.line.character_ns}


def test_a_gauge_of_a_stated_pace_keeps_it():
    read_ns: list[int] = []
    device = gauges.device([SYLVAC], lambda now_ns: [read_ns.append(now_ns) or 1.0])
    paced = timed_device(device, Timing(latch="streamed", cycle_ms=60.0), STEADY, random.Random(1))
    assert {b - a for a, b in pairwise(_messages(paced, read_ns, 100))} == {60 * MS}


def test_a_line_makes_up_for_a_late_message_and_no_more():
    """Its last character is through when it would have been; one that nobody scheduled sets out when it is written."""
    line = PtyLine(Line(baud=4800, bits=7, parity="E", stop=2))
    character_ns = Line(baud=4800, bits=7, parity="E", stop=2).character_ns
    try:
        for late_ms in (1, 300):
            at_ns = max(time.monotonic_ns() - late_ms * MS, line.free_ns)
            line.set_out(at_ns)
            expected_ns = at_ns + 8 * character_ns
            line.write(b"+1.0000\r")
            assert line.free_ns == expected_ns
        before_ns = time.monotonic_ns()
        line.write(b"+1.0000\r")
        assert line.free_ns >= before_ns + 8 * character_ns
    finally:
        line.close()

"""The example stream: literal bytes in, samples and faults out, and its two sides together."""

from __future__ import annotations

import math
import struct

import daq.feedback
from daq.protocol.conversation import NO_TIME, Fault, FaultKind, Sample
from rigs.schema.example_stream import ExampleStream
from tests.support.simulated_conversation import S, Script, simulate

STREAM = ExampleStream(interface="example_stream", port="tcp://127.0.0.1:7000")
ANGLES_DEG = (0.0, -90.0, 90.0, 45.0, -45.0, 180.5)
# By hand: JP, 36 bytes, 2 s in µs, and the six angles as they stand in memory.
MESSAGE = bytes.fromhex(
    "4a 50 00 24 00 00 00 00 00 1e 84 80 00 00 00 00 c2 b4 00 00 42 b4 00 00 42 34 00 00 c2 34 00 00 43 34 80 00"
)


def test_a_message_in_two_pieces_becomes_a_sample_with_the_controller_s_clock() -> None:
    script = Script(daq.feedback.host(STREAM))
    script.receive(MESSAGE[:20], 4)
    script.receive(MESSAGE[20:], 5)
    assert script.taken() == [Sample(ANGLES_DEG, NO_TIME, 4, 5, len(MESSAGE), 2.0)]
    assert script.sent == b""


def test_an_angle_that_no_axis_has_is_garbled_and_the_next_message_is_read() -> None:
    script = Script(daq.feedback.host(STREAM))
    script.receive(MESSAGE[:-4] + struct.pack(">f", math.nan) + MESSAGE)
    fault, sample = script.taken()
    assert isinstance(fault, Fault) and fault.kind is FaultKind.GARBLED
    assert isinstance(sample, Sample)


def test_a_stream_out_of_step_asks_for_a_new_link() -> None:
    script = Script(daq.feedback.host(STREAM))
    step = script.receive(b"XX" + MESSAGE)
    assert step.hang_up
    (fault,) = script.taken()
    assert isinstance(fault, Fault) and fault.kind is FaultKind.GARBLED


def test_what_the_controller_sends_arrives() -> None:
    device = daq.feedback.device(STREAM, lambda now_ns: [now_ns * 1e-9] * 6)
    samples = [item for item in simulate(daq.feedback.host(STREAM), device, 4 * S) if isinstance(item, Sample)]
    assert len(samples) == device.sent > 300

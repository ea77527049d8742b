"""The example arm: literal datagrams in, samples and faults out."""

from __future__ import annotations

import math
import struct

import pytest

import daq.feedback
from daq.protocol.conversation import NO_TIME, Fault, FaultKind, Sample
from rigs.schema.example_arm import ExampleArm
from tests.support.simulated_conversation import Script

ARM = ExampleArm(interface="example_arm", port="udp://127.0.0.1:7000")
ANGLES_DEG = (0.0, -90.0, 90.0, 45.0, -45.0, 180.5)
# By hand: AR, datagram 7, 2 s in µs, and the six angles as they stand in memory.
DATAGRAM = bytes.fromhex(
    "41 52 00 00 00 07 00 00 00 00 00 1e 84 80 00 00 00 00 c2 b4 00 00 42 b4 00 00"
) + bytes.fromhex("42 34 00 00 c2 34 00 00 43 34 80 00")


def test_a_datagram_becomes_a_sample_with_the_controller_s_clock_and_nothing_is_sent() -> None:
    script = Script(daq.feedback.host(ARM))
    script.receive(DATAGRAM, 5)
    assert script.taken() == [Sample(ANGLES_DEG, NO_TIME, 5, 5, len(DATAGRAM), 2.0)]
    assert script.sent == b""


@pytest.mark.parametrize(
    "datagram",
    [DATAGRAM[:-1], DATAGRAM + b"\0", b"XX" + DATAGRAM[2:], DATAGRAM[:-4] + struct.pack(">f", math.nan), b""],
)
def test_what_is_no_position_is_garbled_and_the_next_one_is_read(datagram: bytes) -> None:
    script = Script(daq.feedback.host(ARM))
    script.receive(datagram)
    (fault,) = script.taken()
    assert isinstance(fault, Fault)
    assert fault.kind is FaultKind.GARBLED
    script.receive(DATAGRAM)
    assert isinstance(script.taken()[-1], Sample)


def test_datagrams_that_the_network_loses_are_counted() -> None:
    script = Script(daq.feedback.host(ARM))
    for number in (7, 8, 11):
        script.receive(DATAGRAM[:2] + struct.pack(">I", number) + DATAGRAM[6:], number)
    (fault,) = (item for item in script.taken() if isinstance(item, Fault))
    assert (fault.kind, fault.count) == (FaultKind.SKIPPED, 2)

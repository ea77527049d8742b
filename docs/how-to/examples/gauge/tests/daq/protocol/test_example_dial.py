"""The example dial: its request, and each reply of its manual with what becomes of it."""

from __future__ import annotations

import pytest

import daq.gauges
from daq.protocol.conversation import Fault, FaultKind, Sample
from tests.support.drivers import gauge
from tests.support.simulated_conversation import S, asked


@pytest.mark.parametrize(
    ("reply", "units", "value_mm"),
    [
        (b"D=+012.3456 mm\r\n", "mm", 12.3456),
        (b"D=-000.0001 mm\r\n", "mm", -0.0001),
        (b"D=+001.0000 in\r\n", "inch", 25.4),
    ],
)
def test_a_reading_becomes_mm_and_the_next_is_asked_for(reply: bytes, units: str, value_mm: float) -> None:
    script = asked(daq.gauges.host([gauge("example_dial", units=units)]))
    step = script.receive(reply, S)
    (sample,) = script.taken()
    assert isinstance(sample, Sample)
    assert sample.values == pytest.approx((value_mm,))
    assert (sample.last_byte_ns, sample.size) == (S, len(reply))
    assert step.send == b"D\r"


@pytest.mark.parametrize(
    ("reply", "kind", "words"),
    [
        (b"D!1\r\n", FaultKind.DEVICE_ERROR, "not connected; check its plug"),
        (b"D!2\r\n", FaultKind.DEVICE_ERROR, "out of its range; move it"),
        (b"D=+001.0000 in\r\n", FaultKind.DEVICE_ERROR, "reads in inch"),
        (b"D=12.3456 mm\r\n", FaultKind.GARBLED, "check the line settings"),  # its sign is lost
        (b"D=+012.345 mm\r\n", FaultKind.GARBLED, "check the line settings"),  # a digit is lost
        (b"D!9\r\n", FaultKind.GARBLED, "check the line settings"),
    ],
)
def test_what_is_no_reading_is_a_fault_that_says_what_to_do(reply: bytes, kind: FaultKind, words: str) -> None:
    script = asked(daq.gauges.host([gauge("example_dial")]))
    step = script.receive(reply, S)
    (fault,) = script.taken()
    assert isinstance(fault, Fault)
    assert fault.kind is kind
    assert words in fault.detail
    assert step.send == b"", "nothing is asked before the line has been quiet"

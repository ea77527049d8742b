"""Mitutoyo gauges on a USB virtual COM port (0fe7:4001): the answer to `1` is `01A`, a sign and a number.

A reply starting with `9` is an error (public code, confirmed; the meaning of the numbers is not confirmed). The unit is
not transmitted, so `units` must match the display of the gauge. `V` requests the identification.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from daq.gauges import Read
from daq.protocol.conversation import Device, Host
from daq.protocol.texts import SIGNED, Reading, Show, TextDevice, Trouble, garbled, mm, polled_text, printable_message
from rigs.schema.probe import Probe

_END = b"\r"
_REPLY = re.compile(rb"01A(" + SIGNED + rb")")
_FORMAT = {"mm": "+09.3f", "inch": "+09.5f"}
_LONGEST = 9


def host(gauges: Sequence[Probe]) -> Host:
    return polled_text(gauges, b"1" + _END, _END, read_reply)


def device(gauges: Sequence[Probe], read: Read) -> Device:
    def answer(command: bytes, show: Show) -> bytes:
        if command == b"V":
            return b"V1.000" + _END
        if command != b"1":
            return b"912" + _END
        (value,) = show()
        text = format(value, _FORMAT[gauges[0].units])
        good = math.isfinite(value) and len(text) == _LONGEST
        return (f"01A{text}".encode() if good else b"911") + _END

    return TextDevice(gauges, read, _END, answer)


def read_reply(data: bytes, gauge: Probe) -> Reading:
    match = _REPLY.fullmatch(data)
    if match:
        return mm(match[1], gauge)
    if data.startswith(b"9"):
        return Trouble(
            f"the gauge answers with error {printable_message(data)}; check that the gauge is on and shows a value"
        )
    return garbled(data)

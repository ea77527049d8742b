"""The example dial: `D` is answered by `D=+012.3456 mm` and CR LF, or by `D!` and the number of an error.

A gauge that does not exist, for docs/how-to/add-a-gauge.md. Its unit, mm or in, comes with each reading. Errors:
1, the head is not connected; 2, the head is out of its range.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from daq.gauges import Read
from daq.protocol.conversation import Device, Host
from daq.protocol.texts import Reading, Show, TextDevice, Trouble, garbled, in_mm, polled_text
from rigs.schema.example_dial import ExampleDial

_END = b"\r\n"
_READING = re.compile(rb"D=([+-]\d{3}\.\d{4}) (mm|in)")
_ERRORS = {
    b"D!1": "the head is not connected; check its plug",
    b"D!2": "the head is out of its range; move it",
}


def host(gauges: Sequence[ExampleDial]) -> Host:
    """Return our side of the conversation; a cable carries one gauge."""
    return polled_text(gauges, b"D\r", _END, _read)


def device(gauges: Sequence[ExampleDial], read: Read) -> Device:
    """Return the dial's side of the conversation."""
    unit = "mm" if gauges[0].units == "mm" else "in"

    def answer(command: bytes, show: Show) -> bytes:
        if command != b"D":
            return b""
        (value,) = show()
        return (f"D={value:+09.4f} {unit}" if math.isfinite(value) else "D!1").encode() + _END

    return TextDevice(gauges, read, b"\r", answer)


def _read(data: bytes, gauge: ExampleDial) -> Reading:
    if reading := _READING.fullmatch(data):
        return in_mm(reading[1], reading[2], gauge)
    if data in _ERRORS:
        return Trouble(f"{data.decode()}: {_ERRORS[data]}")
    return garbled(data)

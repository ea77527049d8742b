"""TESA TT80 and TT90: a reading for each `?`, `±xxxx.xx` in mm and `±xxx.xxx` in µm (manual of the maker p. 94).

Only the format indicates the unit, so a reading in the format of the other unit is refused. `ERR23` is confirmed, but
not its meaning. The host uses only `?`; the answers to `ID?`, `UNI?`, `RNG?` and `VER?` are assumptions.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from daq.gauges import Read
from daq.protocol.conversation import Device, Host
from daq.protocol.texts import SIGNED, Reading, Show, TextDevice, Trouble, garbled, in_mm, mm, polled_text
from rigs.schema.gauges import TesaTT

_END = b"\r\n"
_WRITTEN = {b"mm": re.compile(rb"[+-]\d{4}\.\d\d"), b"um": re.compile(rb"[+-]\d{3}\.\d{3}")}
_FORMAT = {"mm": "+08.2f", "um": "+08.3f"}


def host(gauges: Sequence[TesaTT]) -> Host:
    return polled_text(gauges, b"?\r", _END, _read)


def device(gauges: Sequence[TesaTT], read: Read) -> Device:
    units = gauges[0].units
    texts = {b"ID?": b"TESA TT80", b"UNI?": units.upper().encode(), b"RNG?": b"2", b"VER?": b"1.0"}

    def answer(command: bytes, show: Show) -> bytes:
        if command != b"?":
            return texts.get(command, b"ERR1") + _END
        (value,) = show()
        return (format(value, _FORMAT[units]).encode() if math.isfinite(value) else b"ERR23") + _END

    return TextDevice(gauges, read, b"\r", answer)


def _read(data: bytes, gauge: TesaTT) -> Reading:
    for unit, written in _WRITTEN.items():
        if written.fullmatch(data):
            return in_mm(data, unit, gauge)
    if re.fullmatch(SIGNED, data):
        return mm(data, gauge)
    if re.fullmatch(rb"ERR\d{1,3}", data):
        return Trouble(f"{data.decode()}: see the gauge's manual; check the probe and the range")
    return garbled(data)

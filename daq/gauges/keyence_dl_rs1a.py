"""Keyence DL-RS1A with its GT2 heads: `M0` asks for all of them at once, main unit first.

`M0,-00.007,+00.018` answers it (seen on a wire: two heads, confirmed); `ER,<command>,<number>` refuses,
numbers up to 29 from the DL-RS1A/GT2 manual p. 14 (confirmed by its text),
65 to 67 from manuals of other amplifiers on the same unit (weak). `channel` is the field, from 1 (ID
00) on.

A head out of range answers a number: all nines, or `-99.998` while it has no value (DL-RS1A/SK-1000 manual
p. 11, which also gives `+EE.EEE` for an amplifier error; weak for GT2, whose own table was not to be had).
So all nines are never taken for a reading. The GT2 manual gives nine characters, `±***.****`; the number of
digits is left open. M0 answers from a buffer the DL-RS1A refreshes by itself: readings are older than their
request by its cycle.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from daq.gauges import Read
from daq.protocol.conversation import Conversation, Device, Fault, FaultKind, Sample, Step
from daq.protocol.framing import Lines, Message
from daq.protocol.polled import Heard, Polled, Then
from rigs.gauges import MM_PER_UNIT, KeyenceDLRS1A

_END = b"\r\n"
_NUMBER = re.compile(rb"[+-]\d{1,7}\.\d{1,7}")
_NO_VALUE = re.compile(rb"[+-]9+\.9+|-9+\.9+8")
_ERRORS = {
    b"00": "invalid command; is it a DL-RS1A?",
    b"02": "no contact between DL-RS1A and amplifier; wait until the amplifiers have started",
    b"20": "wrong length of data; check the line's settings",
    b"21": "wrong number of parameters; check the line's settings",
    b"22": "parameter error; check the amplifiers' settings",
    b"29": "error on the RS-232C line; check the line's settings against the DL-RS1A's switches",
    b"65": "wrong ID number; check the amplifiers' connection",
    b"66": "no contact on the expansion line; check the amplifiers' connection",
    b"67": "not writable; set the DL-RS1A's switch to R/W",
}
_FORMAT = {"mm": "+07.3f", "um": "+08.1f", "inch": "+08.5f"}


def host(gauges: Sequence[KeyenceDLRS1A]) -> Conversation:
    """Our side."""
    return Polled(_Asking(gauges), gauges[0].timeout_s)


def device(gauges: Sequence[KeyenceDLRS1A], read: Read) -> Device:
    """The communication unit's side."""
    return _Unit(gauges, read)


class _Asking:
    """`M0`, of whose answer each gauge has its field."""

    reset = b""
    check = "check the cable, that the DL-RS1A has power, and the line's settings against its switches"

    def __init__(self, gauges: Sequence[KeyenceDLRS1A]) -> None:
        self.frames = Lines(_END)
        self._gauges = gauges

    def request(self) -> bytes:
        return b"M0" + _END

    def read(self, message: Message, requested_ns: int) -> Heard:
        at_ns = message.last_byte_ns
        name, *fields = message.data.split(b",")
        if name == b"ER" and len(fields) == 2:
            meaning = _ERRORS.get(fields[1], "unknown error number; see the DL-RS1A's manual")
            detail = f"{_text(message.data)}: {meaning}"
            return Heard((Fault(FaultKind.DEVICE_ERROR, at_ns, detail),), Then.PAUSE)
        if name != b"M0":
            detail = f"{_text(message.data)} answers no M0; check the line's settings"
            return Heard((Fault(FaultKind.GARBLED, at_ns, detail),), Then.DRAIN)
        readings = [_value(fields, gauge, at_ns) for gauge in self._gauges]
        faults = tuple(reading for reading in readings if isinstance(reading, Fault))
        if len(faults) == len(readings):
            return Heard(faults, Then.PAUSE)
        values = tuple(math.nan if isinstance(reading, Fault) else reading for reading in readings)
        sample = Sample(values, requested_ns, message.first_byte_ns, at_ns, message.size)
        return Heard((sample, *faults))


def _value(fields: Sequence[bytes], gauge: KeyenceDLRS1A, at_ns: int) -> float | Fault:
    """The gauge's field in mm, or why there is none."""
    field = fields[gauge.channel - 1] if gauge.channel <= len(fields) else b""
    if not field:
        detail = f"no head on channel {gauge.channel}, {len(fields)} answer; check the amplifiers and `channel`"
        return Fault(FaultKind.MISSING, at_ns, detail)
    if not _NUMBER.fullmatch(field) or _NO_VALUE.fullmatch(field):
        detail = f"channel {gauge.channel} shows {_text(field)}: out of range or in error; check the head"
        return Fault(FaultKind.DEVICE_ERROR, at_ns, detail)
    return float(field) * MM_PER_UNIT[gauge.units]


def _text(data: bytes) -> str:
    return repr(data[:60])[1:]


class _Unit:
    """The instrument, with heads up to the last channel asked for; those of no gauge here read zero."""

    def __init__(self, gauges: Sequence[KeyenceDLRS1A], read: Read) -> None:
        self.sent = 0
        self._gauges = gauges
        self._read = read
        self._frames = Lines(_END)

    def connected(self, now_ns: int) -> Step:
        return Step()

    def received(self, data: bytes, now_ns: int) -> Step:
        messages = self._frames.feed(data, now_ns)
        return Step(b"".join(self._answer(message, now_ns) for message in messages))

    def tick(self, now_ns: int) -> Step:
        return Step()

    def _answer(self, message: Message | Fault, now_ns: int) -> bytes:
        if isinstance(message, Fault):
            return b"ER,,20" + _END
        if message.data != b"M0":
            return b"ER," + message.data.split(b",")[0][:2] + b",00" + _END
        units = self._gauges[0].units
        fields = [format(0.0, _FORMAT[units])] * max(gauge.channel for gauge in self._gauges)
        for gauge, value_mm in zip(self._gauges, self._read(now_ns), strict=True):
            value = value_mm / MM_PER_UNIT[units]
            fields[gauge.channel - 1] = format(value, _FORMAT[units]) if math.isfinite(value) else "+EE.EEE"
        self.sent += 1
        return b"M0," + ",".join(fields).encode() + _END

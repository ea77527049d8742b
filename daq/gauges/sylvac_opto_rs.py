"""Sylvac Opto-RS, simplex or duplex cable: a reading for each `?`, or reading after reading after `OUT1`.

Commands and replies end in CR: `?`, `ID?`, `UNI?`, `SET?`, `MOD?`, `OUT1`, `OUT0`. A reading is a sign
(`+`, `-` or a blank), digits, a point, digits, and in tolerance mode one of `<` `=` `>`; errors are `ERR0`
… `ERR3`; `SY…` comes at power-on, when a cable has forgotten `OUT1` (maker's manuals, confirmed). What
`ID?`, `UNI?`, `SET?` and `MOD?` answer, and that `OUT0` and `OUT1` are not answered, is believed only: the
host uses none of it.

The sign must be there: a reading that lost its first byte would otherwise pass with the wrong sign.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from daq.gauges import Read
from daq.protocol import polled, streamed
from daq.protocol.conversation import NO_TIME, Conversation, Device, Fault, FaultKind, Sample, Step
from daq.protocol.framing import Lines, Message
from rigs.gauges import MM_PER_UNIT, SylvacOptoRS

_READING = re.compile(rb"([+\- ])(\d{1,7}\.\d{1,7})[<=>]?")
_ERRORS = {
    b"ERR0": "sensor error; clean the probe and check that it is plugged in",
    b"ERR1": "command not understood; check the line's settings",
    b"ERR2": "parity error; check the line's settings and the cable",
    b"ERR3": "value out of range; move the probe into its range",
}
_CHECK = "check the cable, that the gauge is on, and the line's settings"
_DECIMALS = {"mm": 4, "um": 1, "inch": 5}


def host(gauges: Sequence[SylvacOptoRS]) -> Conversation:
    """Our side; one gauge a cable."""
    (gauge,) = gauges
    if gauge.mode == "continuous":
        return streamed.Streamed(_Continuous(gauge), gauge.timeout_s)
    return polled.Polled(_Asking(gauge), gauge.timeout_s)


def device(gauges: Sequence[SylvacOptoRS], read: Read) -> Device:
    """The cable's side."""
    (gauge,) = gauges
    return _Cable(gauge, read)


def _reading(message: Message, requested_ns: int, mm_per_unit: float) -> Sample | Fault:
    match = _READING.fullmatch(message.data)
    if match:
        value = float(match[2]) * mm_per_unit * (-1 if match[1] == b"-" else 1)
        return Sample((value,), requested_ns, message.first_byte_ns, message.last_byte_ns, message.size)
    at_ns = message.last_byte_ns
    if message.data in _ERRORS:
        return Fault(FaultKind.DEVICE_ERROR, at_ns, f"{message.data.decode()}: {_ERRORS[message.data]}")
    if message.data.startswith(b"SY"):
        return Fault(FaultKind.DEVICE_ERROR, at_ns, "the gauge was switched on anew; check its supply and its zero")
    return Fault(FaultKind.GARBLED, at_ns, f"{message.data[:40]!r} is no reading; check the line's settings")


class _Asking:
    """`?`, and `OUT0` first, for a cable left in continuous mode."""

    reset = b"OUT0\r"
    check = _CHECK

    def __init__(self, gauge: SylvacOptoRS) -> None:
        self.frames = Lines(b"\r")
        self._mm_per_unit = MM_PER_UNIT[gauge.units]

    def request(self) -> bytes:
        return b"?\r"

    def read(self, message: Message, requested_ns: int) -> polled.Heard:
        item = _reading(message, requested_ns, self._mm_per_unit)
        if isinstance(item, Sample):
            return polled.Heard((item,))
        return polled.Heard((item,), polled.Then.PAUSE if message.data in _ERRORS else polled.Then.DRAIN)


class _Continuous:
    """`OUT1`, and again whenever the cable may have forgotten it."""

    check = _CHECK

    def __init__(self, gauge: SylvacOptoRS) -> None:
        self.frames = Lines(b"\r")
        self._mm_per_unit = MM_PER_UNIT[gauge.units]

    def start(self) -> bytes:
        return b"OUT1\r"

    def read(self, message: Message | Fault) -> streamed.Heard:
        if isinstance(message, Fault):
            return streamed.Heard((message,))
        item = _reading(message, NO_TIME, self._mm_per_unit)
        return streamed.Heard((item,), send=self.start() if message.data.startswith(b"SY") else b"")

    def silent(self) -> streamed.Heard:
        return streamed.Heard(send=self.start())


class _Cable:
    """The instrument; in continuous mode it speaks whenever the line is free, so it asks to be woken now."""

    def __init__(self, gauge: SylvacOptoRS, read: Read) -> None:
        self.sent = 0
        self._read = read
        self._units = gauge.units
        self._frames = Lines(b"\r")
        self._continuous = False

    def connected(self, now_ns: int) -> Step:
        return self._step(b"", now_ns)

    def received(self, data: bytes, now_ns: int) -> Step:
        answers = [
            self._answer(message.data, now_ns) if isinstance(message, Message) else b"ERR1\r"
            for message in self._frames.feed(data, now_ns)
        ]
        return self._step(b"".join(answers), now_ns)

    def tick(self, now_ns: int) -> Step:
        return self._step(self._reading(now_ns) if self._continuous else b"", now_ns)

    def _step(self, send: bytes, now_ns: int) -> Step:
        return Step(send, wake_ns=now_ns if self._continuous else None)

    def _answer(self, command: bytes, now_ns: int) -> bytes:
        if command in {b"OUT0", b"OUT1"}:
            self._continuous = command == b"OUT1"
            return b""
        if command == b"?":
            return self._reading(now_ns)
        unit = b"IN" if self._units == "inch" else b"MM"
        known = {b"ID?": b"SY emulated", b"UNI?": unit, b"SET?": unit + b" +", b"MOD?": b"NOR"}
        return known.get(command, b"ERR1") + b"\r"

    def _reading(self, now_ns: int) -> bytes:
        value = self._read(now_ns)[0] / MM_PER_UNIT[self._units]
        if not math.isfinite(value):
            return b"ERR0\r"
        self.sent += 1
        return f"{value:+.{_DECIMALS[self._units]}f}\r".encode()

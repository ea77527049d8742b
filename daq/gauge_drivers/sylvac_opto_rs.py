"""Sylvac Opto-RS, simplex or duplex cable: a reading for each `?`, or continuous readings after `OUT1`.

Commands and replies end in CR. A reading consists of a sign (`+`, `-` or a blank), digits, a point, digits, and in
tolerance mode one of `<` `=` `>`. `SY…` is sent at power-on, after which the cable is no longer in the mode `OUT1`. A
simplex cable receives no commands and sends a reading when DTR goes off (manuals of the maker, confirmed). The answers
to `ID?`, `UNI?`, `SET?` and `MOD?`, and the absence of answers to `OUT0` and `OUT1`, are assumptions; the host does
not rely on them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from daq.gauges import Read
from daq.protocol import polled, streamed
from daq.protocol.conversation import NO_TIME, ConversationStep, Device, FaultKind, Host
from daq.protocol.framing import DelimitedLines, Message
from daq.protocol.numerals import NumberFormat
from daq.protocol.polled import AskedByLine
from daq.protocol.texts import (
    CHECK,
    Reading,
    Show,
    TextDevice,
    TextDialect,
    Trouble,
    check_formats,
    garbled,
    items_of,
    mm,
    polled_text,
    printable_message,
)
from rigs.schema.gauges import SylvacOptoRS

_END = b"\r"
_READING = re.compile(rb"([+\- ]\d{1,7}\.\d{1,7})[<=>]?")
_COMMA = re.compile(rb"[+\- ]\d{1,7},\d{1,7}[<=>]?")
_ERRORS = {
    b"ERR0": "sensor error; clean the probe and check the plug",
    b"ERR1": "command not understood; check the line settings",
    b"ERR2": "parity error; check the line settings and the cable",
    b"ERR3": "value out of range; move the probe into the range",
}
_BY_LINE = b"?"
"""Request of a simplex cable, represented by a pulse of DTR."""
_OFF_NS = 120_000_000
"""DTR off for at least 110 ms requests a reading from a simplex cable.

Source: Sylvac Opto instruments, user manual p. 12-13.
"""
_DECIMALS = {"mm": 4, "um": 1, "inch": 5}


def host(gauges: Sequence[SylvacOptoRS]) -> Host:
    (gauge,) = gauges
    if gauge.mode == "continuous":
        return streamed.Streamed(_Continuous(gauge), gauge.timeout_s)
    if gauge.cable == "simplex":
        dialect = TextDialect(gauges, _BY_LINE, DelimitedLines(_END), _read)
        return AskedByLine(polled.Polled(dialect, gauge.timeout_s, shared=True), _OFF_NS)
    # The cable may still be in continuous mode.
    return polled_text(gauges, b"?\r", _END, _read, reset=b"OUT0\r")


def device(gauges: Sequence[SylvacOptoRS], read: Read) -> Device:
    return _Cable(gauges[0], read)


def _read(data: bytes, gauge: SylvacOptoRS) -> Reading:
    if match := _READING.fullmatch(data):
        return mm(match[1], gauge)
    if _COMMA.fullmatch(data):
        detail = (
            f"{printable_message(data)} has a decimal comma; set a decimal point in the gauge or the gauge software"
        )
        return Trouble(detail, FaultKind.GARBLED, polled.Then.DRAIN)
    if data in _ERRORS:
        return Trouble(f"{data.decode()}: {_ERRORS[data]}")
    if data.startswith(b"SY"):
        return Trouble("the gauge was switched on again; check the supply and the zero", then=polled.Then.DRAIN)
    return garbled(data)


class _Continuous(streamed.StreamedDialect):
    """Sends `OUT1`, and repeats it whenever the cable may have left this mode."""

    check = CHECK

    def __init__(self, gauge: SylvacOptoRS) -> None:
        self.frames = DelimitedLines(_END)
        self.formats = [NumberFormat()]
        self._gauge = gauge

    def start(self) -> bytes:
        return b"OUT1\r"

    def read(self, message: Message) -> streamed.Reaction:
        readings, earlier, doubts = check_formats([_read(message.data, self._gauge)], self.formats, message)
        items = items_of(message, NO_TIME, readings)
        return streamed.Reaction(
            (*earlier, *items, *doubts), send=self.start() if message.data.startswith(b"SY") else b""
        )

    def silent(self) -> streamed.Reaction:
        return streamed.Reaction(send=self.start())


class _Cable(TextDevice):
    """The instrument. In continuous mode it sends whenever the line is free, so it requests an immediate wake-up."""

    def __init__(self, gauge: SylvacOptoRS, read: Read) -> None:
        super().__init__([gauge], read, _END, self._reply)
        self._units = gauge.units
        self._continuous = False

    def connected(self, now_ns: int) -> ConversationStep:
        return self._step(b"", now_ns)

    def received(self, data: bytes, now_ns: int) -> ConversationStep:
        return self._step(super().received(data, now_ns).send, now_ns)

    def tick(self, now_ns: int) -> ConversationStep:
        return self._step(self._reply(b"?", lambda: self.show(now_ns)) if self._continuous else b"", now_ns)

    def _step(self, send: bytes, now_ns: int) -> ConversationStep:
        return ConversationStep(send, wake_ns=now_ns if self._continuous else None)

    def _reply(self, command: bytes, show: Show) -> bytes:
        if command in {b"OUT0", b"OUT1"}:
            self._continuous = command == b"OUT1"
            return b""
        if command == b"?":
            (value,) = show()
            return (f"{value:+.{_DECIMALS[self._units]}f}".encode() if math.isfinite(value) else b"ERR0") + _END
        unit = b"IN" if self._units == "inch" else b"MM"
        answers = {b"ID?": b"SY emulated", b"UNI?": unit, b"SET?": unit + b" +", b"MOD?": b"NOR"}
        return answers.get(command, b"ERR1") + _END

"""Heidenhain ND 287: `ESC A0100` asks for what its display shows: STX, 10 to 13 characters, CR LF.

Commands and NAK for one that it does not know: maker's manual p. 102-108 (confirmed). The display is asked rather
than the position, `ESC A0200`, which its sisters (ND 281 B, ND 720) send without the decimal point. It shows its
dialogs and errors in the same place, and no unit, so `units` must be that of its display. Public
drivers ask for the unit by `ESC A0800` and ignore NULs before an answer; what that question is answered with was not
found, so it is not asked.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace

from daq.gauges import Read
from daq.protocol.conversation import Device, Fault, Host
from daq.protocol.framing import Lines, Message
from daq.protocol.polled import Polled
from daq.protocol.texts import Reading, Show, TextDevice, TextDialect, Trouble, garbled, mm, shown
from rigs.schema.serial_gauges import HeidenhainND287

_STX, _NAK, _NUL, _END = b"\x02", b"\x15", b"\0", b"\r\n"
_DISPLAY, _POSITION, _IDENTITY, _ERROR = b"\x1bA0100", b"\x1bA0200", b"\x1bA0000", b"\x1bA0301"
_TEXT = re.compile(rb"\x02([ -~]{10,13})")
_NUMBER = re.compile(rb" *[+-]? *\d+\.\d+ *")
_DECIMALS = {"mm": 4, "inch": 5}


def host(gauges: Sequence[HeidenhainND287]) -> Host:
    """Return our side of the conversation; a cable carries one gauge."""
    return Polled(TextDialect(gauges, _DISPLAY + b"\r", _Replies(_END), _read), gauges[0].timeout_s)


def device(gauges: Sequence[HeidenhainND287], read: Read) -> Device:
    """Return the instrument's side of the conversation; its display shows a head in error."""
    decimals = _DECIMALS[gauges[0].units]

    def answer(command: bytes, show: Show) -> bytes:
        if command == _IDENTITY:
            return _STX + _END.join((b"ND-287    ", b"646118-01 ", b"V1-01     ", b""))
        if command == _ERROR:
            return _STX + b"NO ERROR     " + _END
        if command not in {_DISPLAY, _POSITION}:
            return _NAK
        (value,) = show()
        if not math.isfinite(value):
            return _STX + b"SIGNAL ERROR " + _END
        if command == _POSITION:
            return _STX + f"{round(value * 10**decimals):+010d}".encode() + _END
        return _STX + f"{'-' if value < 0 else ' '}{abs(value):10.{decimals}f}".encode() + _END

    return TextDevice(gauges, read, Lines(b"\r"), answer)


class _Replies(Lines):
    """Lines, of which NAK is one by itself, and which NULs may precede.

    A NUL within a line is a character of wrong parity (`daq.wire.serial_port`), without which the number is another.
    """

    def feed(self, data: bytes, now_ns: int) -> Sequence[Message | Fault]:
        found = super().feed(data.replace(_NAK, _NAK + _END), now_ns)
        return [one if isinstance(one, Fault) else replace(one, data=one.data.lstrip(_NUL)) for one in found]


def _read(data: bytes, gauge: HeidenhainND287) -> Reading:
    if data == _NAK:
        return Trouble("command not understood (NAK); is it an ND 287?")
    text = _TEXT.fullmatch(data)
    if not text:
        return garbled(data)
    if not _NUMBER.fullmatch(text[1]):
        return Trouble(f"the display shows {shown(text[1].strip())}; close the dialog or clear the error")
    return mm(text[1], gauge)

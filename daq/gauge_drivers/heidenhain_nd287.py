"""Heidenhain ND 287: `ESC A0100` requests the display content: STX, 10 to 13 characters, CR LF.

Commands, and NAK for unknown commands: manual of the maker p. 102-108 (confirmed). The display is read instead of the
position `ESC A0200`, because related models (ND 281 B, ND 720) send the position without the decimal point. The unit is
only in the status bar, `ESC A0800`: STX, a digit each for operating mode, input, scale factor, compensation, stopwatch,
unit (0 mm, 1 inch, 2 to 4 angles), datum and soft-key page, CR LF (public driver). Public drivers ignore NULs before an
answer.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace

from daq.gauges import Read
from daq.protocol.conversation import Device, Fault, Host
from daq.protocol.framing import DelimitedLines, Message
from daq.protocol.polled import Polled, Reply
from daq.protocol.texts import (
    Reading,
    Show,
    TextDevice,
    TextDialect,
    Trouble,
    garbled,
    mm,
    printable_message,
    wrong_unit,
)
from rigs.schema.gauges import HeidenhainND287

_STX, _NAK, _NUL, _END = b"\x02", b"\x15", b"\0", b"\r\n"
_DISPLAY, _POSITION, _IDENTITY, _ERROR = b"\x1bA0100", b"\x1bA0200", b"\x1bA0000", b"\x1bA0301"
_TEXT = re.compile(rb"\x02([ -~]{10,13})")
_NUMBER = re.compile(rb" *[+-]? *\d+\.\d+ *")
_STATUS = b"\x1bA0800"
_STATUS_BAR = re.compile(rb"\x02 *(?P<mode>\d) *(?:\d *){4}(?P<unit>\d) *(?:\d *){2}")
_STATUS_REPLY = re.compile(rb"\x02[ -~]*|\x15")
_UNITS = {"mm": b"0", "inch": b"1"}
_DECIMALS = {"mm": 4, "inch": 5}
STATUS_EVERY = 50
"""Requests per status request: a change of unit is detected within seconds, at the cost of 2 % of the readings."""


def host(gauges: Sequence[HeidenhainND287]) -> Host:
    return Polled(_Dialect(gauges), gauges[0].timeout_s)


def device(gauges: Sequence[HeidenhainND287], read: Read) -> Device:
    """The display indicates a head in error."""
    units = gauges[0].units
    decimals = _DECIMALS[units]
    fixed = {
        _IDENTITY: _END.join((b"ND-287    ", b"646118-01 ", b"V1-01     ", b"")),
        _ERROR: b"NO ERROR     " + _END,
        _STATUS: b"00000" + _UNITS[units] + b"11" + _END,
    }

    def answer(command: bytes, show: Show) -> bytes:
        if command in fixed:
            return _STX + fixed[command]
        if command not in {_DISPLAY, _POSITION}:
            return _NAK
        (value,) = show()
        if not math.isfinite(value):
            return _STX + b"SIGNAL ERROR " + _END
        if command == _POSITION:
            return _STX + f"{round(value * 10**decimals):+010d}".encode() + _END
        return _STX + f"{'-' if value < 0 else ' '}{abs(value):10.{decimals}f}".encode() + _END

    return TextDevice(gauges, read, b"\r", answer)


class _Dialect(TextDialect[HeidenhainND287]):
    """Periodic status requests, repeated while the status forbids reading."""

    def __init__(self, gauges: Sequence[HeidenhainND287]) -> None:
        self._replies = _Replies(_END)
        super().__init__(gauges, _DISPLAY + b"\r", self._replies, _read)
        self._units = gauges[0].units
        self._questions = 0
        self._asked_status = False

    def request(self) -> bytes:
        self._asked_status = self._questions % STATUS_EVERY == 0
        self._questions += 1
        self._replies.echo = _STATUS + b"\r" if self._asked_status else super().request()
        return self._replies.echo

    def read(self, message: Message, requested_ns: int) -> Reply:
        if not self._asked_status or not _STATUS_REPLY.fullmatch(message.data):
            return super().read(message, requested_ns)
        bar = _STATUS_BAR.fullmatch(message.data)
        if bar and bar["mode"] != b"0":
            trouble = Trouble("the display shows the distance to go; switch to ACTUAL VALUE")
        elif bar and bar["unit"] != _UNITS[self._units]:
            trouble = wrong_unit({b"0": "mm", b"1": "inch"}.get(bar["unit"], "an angle"), self._units)
        else:
            return Reply(())
        self._questions = 0
        return Reply((message.fault(trouble.kind, trouble.detail),), trouble.then)


class _Replies(DelimitedLines):
    """Lines with NAK as a separate line and optional leading NULs.

    A NUL within a line is a character of wrong parity (`daq.wire.serial_port`). Removing it would change the number.
    """

    def feed(self, data: bytes, now_ns: int) -> Sequence[Message | Fault]:
        messages = super().feed(data.replace(_NAK, _NAK + _END), now_ns)
        return [
            message if isinstance(message, Fault) else replace(message, data=message.data.lstrip(_NUL))
            for message in messages
        ]


def _read(data: bytes, gauge: HeidenhainND287) -> Reading:
    if data == _NAK:
        return Trouble("command rejected (NAK); check that the device is an ND 287")
    text = _TEXT.fullmatch(data)
    if not text:
        return garbled(data)
    if not _NUMBER.fullmatch(text[1]):
        return Trouble(f"the display shows {printable_message(text[1].strip())}; close the dialog or clear the error")
    return mm(text[1], gauge)

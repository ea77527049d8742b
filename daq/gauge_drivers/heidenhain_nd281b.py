"""Heidenhain ND 281 B: STX requests a value, which is latched within 1 ms and sent within 50 ms. At 9600 baud this
gives about 14 readings/s.

Format: sign, number with leading blanks (10 characters), blank, unit (blank mm, `"` inch, `?` fault), sorting (`<` `=`
`>` `?`), series of measurements (S minimum, A actual, G maximum, D difference), CR LF (manual of the maker p. 39-42,
confirmed; the sign in addition to the 10 characters is taken from the figure there). Only the actual value is accepted:
in a series the display may show a value that is not a position.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from daq.gauges import Read
from daq.protocol.conversation import Device, Host
from daq.protocol.framing import Sized
from daq.protocol.texts import Reading, Show, TextDevice, Trouble, garbled, in_mm, polled_text
from rigs.schema.gauges import HeidenhainND281B

_STX, _ENQ, _END = b"\x02", b"\x05", b"\r\n"
_FIELDS = re.compile(rb"([+-] *\d+\.\d+) ([ \"?])[ <=>?]([ SAGD])")
_LENGTH = 15
_UNIT = {b" ": b"mm", b'"': b"inch"}
_SERIES = {b"S": "minimum", b"G": "maximum", b"D": "difference"}
_SIGN = {"mm": " ", "inch": '"'}
_DECIMALS = {"mm": 4, "inch": 5}


def host(gauges: Sequence[HeidenhainND281B]) -> Host:
    return polled_text(gauges, _STX, _END, _read)


def device(gauges: Sequence[HeidenhainND281B], read: Read) -> Device:
    units = gauges[0].units

    def answer(command: bytes, show: Show) -> bytes:
        if command == _ENQ:
            return f"{'NO ERROR':13}".encode() + _END
        if command != _STX:
            return b""
        (value,) = show()
        good = math.isfinite(value)
        number = f"{abs(value) if good else 0.0:10.{_DECIMALS[units]}f}"
        sign = "-" if good and value < 0 else "+"
        return f"{sign}{number} {_SIGN[units] if good else '?'}  ".encode() + _END

    return TextDevice(gauges, read, Sized(1, lambda head: 1), answer)


def _read(data: bytes, gauge: HeidenhainND281B) -> Reading:
    fields = _FIELDS.fullmatch(data)
    if not fields or len(data) != _LENGTH:
        return garbled(data)
    number, unit, series = fields.groups()
    if unit == b"?":
        return Trouble("the display reports a fault; see the error message and clear it")
    if series in _SERIES:
        return Trouble(f"the display shows the {_SERIES[series]} of a series; end the series, or switch to ACTL")
    return in_mm(number, _UNIT[unit], gauge)

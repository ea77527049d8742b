"""CDI and Starrett IQ indicators: the answer to `R` has fifteen characters, `±########, MM` and CR LF.

One of the eight digits is the decimal point; blanks are possible. Each reading contains the unit, MM or IN. `NOT
FOUND`, `NO ACCESS`, `OUT OF BOUNDS` and `NON NUMERIC` are error answers (pages of the makers, confirmed).
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from daq.gauges import Read
from daq.protocol.conversation import Device, Host
from daq.protocol.texts import Reading, Show, TextDevice, Trouble, garbled, in_mm, polled_text
from rigs.schema.gauges import CDIIQ

_END = b"\r\n"
_REPLY = re.compile(rb"([+-][ \d.]{8}), (MM|IN)")
_NUMBER = re.compile(rb"[+-]\d+\.\d+")
_REFUSALS = {
    b"NOT FOUND": "does not know the command",
    b"NO ACCESS": "refuses access",
    b"OUT OF BOUNDS": "is out of bounds",
    b"NON NUMERIC": "has no number",
}
_DECIMALS = {"mm": 4, "inch": 5}


def host(gauges: Sequence[CDIIQ]) -> Host:
    return polled_text(gauges, b"R\r", _END, _read)


def device(gauges: Sequence[CDIIQ], read: Read) -> Device:
    units = gauges[0].units

    def answer(command: bytes, show: Show) -> bytes:
        if command != b"R":
            return b"NOT FOUND" + _END
        (value,) = show()
        number = f"{abs(value):8.{_DECIMALS[units]}f}"
        if not math.isfinite(value) or len(number) > 8:
            return b"OUT OF BOUNDS" + _END
        return f"{'-' if value < 0 else '+'}{number}, {'MM' if units == 'mm' else 'IN'}".encode() + _END

    return TextDevice(gauges, read, b"\r", answer)


def _read(data: bytes, gauge: CDIIQ) -> Reading:
    reply = _REPLY.fullmatch(data)
    if reply and _NUMBER.fullmatch(reply[1].replace(b" ", b"")):
        return in_mm(reply[1], reply[2], gauge)
    if data in _REFUSALS:
        return Trouble(f"{data.decode()}: the indicator {_REFUSALS[data]}; check the display, and leave the menu")
    return garbled(data)

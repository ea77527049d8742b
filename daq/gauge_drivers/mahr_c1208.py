"""Mahr Millimar C1208, C1216 and C1240, using a protocol selected in the menu.

OPTORSD and OPTORSS: the answer to `?` is `xxx.xxx<unit>`. M1240: the answer to `M` is `M1, xxx.xxx` with no unit
(manual of the maker p. 67-70, confirmed; baud rate not given). Each `x` is a digit of the display, with a sign only if
shown.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from daq.gauges import Read
from daq.protocol.conversation import Device, Host
from daq.protocol.texts import CHECK, Reading, Show, TextDevice, garbled, in_mm, mm, polled_text
from rigs.schema.gauges import MahrC1208

_NUMBER = rb"([+-]? *\d{1,7}\.\d{1,7})"
_REPLY = {"optorsd": re.compile(_NUMBER + rb" ?([A-Za-z]+)"), "m1240": re.compile(rb"M1, *" + _NUMBER)}
_REQUEST = {"optorsd": b"?", "m1240": b"M"}
_END = {"optorsd": b"\r\n", "m1240": b"\r"}
_FORMAT = {"mm": "08.4f", "um": "07.2f", "inch": "09.5f"}
_WORD = {"mm": "mm", "um": "um", "inch": "in"}
_CHECK = f"close the menu and end any master measurement, during which it is silent; {CHECK}, and `protocol`"


def host(gauges: Sequence[MahrC1208]) -> Host:
    protocol = gauges[0].protocol
    return polled_text(gauges, _REQUEST[protocol] + b"\r", _END[protocol], _read, _CHECK)


def device(gauges: Sequence[MahrC1208], read: Read) -> Device:
    """If the measuring head is in error, the instrument is silent, as with an open menu."""
    (gauge,) = gauges

    def answer(command: bytes, show: Show) -> bytes:
        if command != _REQUEST[gauge.protocol]:
            return b""
        (value,) = show()
        if not math.isfinite(value):
            return b""
        text = f"{'-' if value < 0 else ''}{format(abs(value), _FORMAT[gauge.units])}"
        text = f"M1, {text}" if gauge.protocol == "m1240" else text + _WORD[gauge.units]
        return text.encode() + _END[gauge.protocol]

    return TextDevice(gauges, read, b"\r", answer)


def _read(data: bytes, gauge: MahrC1208) -> Reading:
    match = _REPLY[gauge.protocol].fullmatch(data)
    if not match:
        return garbled(data)
    has_sign = match[1][:1] in b"+-"
    number = match[1] if match[1][:1] in b"+- " else b" " + match[1]  # position of the omitted sign
    if gauge.protocol == "m1240":
        return mm(number, gauge, omits_plus=not has_sign)
    return in_mm(number, match[2], gauge, omits_plus=not has_sign)

"""Mitutoyo QM-Height on the USB port: the replies of `mitutoyo_usb`, each with twelve characters and CR.

`01A+0000.123` in mm, `01A+00.12345` or `01A+000.1234` in inch (manual of the maker p. 73, confirmed): the number of
decimals indicates the unit. The request `1` is assumed to be the same, not confirmed.
"""

from __future__ import annotations

from collections.abc import Sequence

from daq.gauge_drivers import mitutoyo_usb
from daq.gauges import Read
from daq.protocol.conversation import Device, Host
from daq.protocol.texts import Reading, Trouble, garbled, in_mm, polled_text
from rigs.schema.gauges import MitutoyoQMHeight

_LENGTH = 12
_UNIT = {3: b"mm", 4: b"inch", 5: b"inch"}


def host(gauges: Sequence[MitutoyoQMHeight]) -> Host:
    return polled_text(gauges, b"1\r", b"\r", _read)


def device(gauges: Sequence[MitutoyoQMHeight], read: Read) -> Device:
    return mitutoyo_usb.device(gauges, read)


def _read(data: bytes, gauge: MitutoyoQMHeight) -> Reading:
    reading = mitutoyo_usb.read_reply(data, gauge)
    if isinstance(reading, Trouble):
        return reading
    unit = _UNIT.get(len(data.partition(b".")[2]))
    return in_mm(data[3:], unit, gauge) if unit and len(data) == _LENGTH else garbled(data)

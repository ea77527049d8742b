"""Magnescale MG80-SC: the answer to the request in the rig file. The protocol could not be confirmed.

The answer has a header of five characters (module, counter, mode, unit `M`, comparator `U` `G` `L` `E`), followed by
`±99.9999`. An overflow is `±F0.0000`, an alarm `"  Error "` (manual of the maker p. 39, confirmed). The mode letters
and `I` for inch are assumed to be those of the LT20A, whose decoder is used.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from daq.gauge_drivers.magnescale_lt import value_of, written
from daq.gauges import Read
from daq.protocol.conversation import Device, FaultKind, Host
from daq.protocol.texts import CHECK, Reading, Show, TextDevice, Trouble, garbled, polled_text
from rigs.schema.gauges import MagnescaleMG80

_END = b"\r\n"
_LENGTH = 13


def host(gauges: Sequence[MagnescaleMG80]) -> Host:
    request = gauges[0].request.encode() + _END
    return polled_text(gauges, request, _END, _read, f"{CHECK}, and `request`")


def device(gauges: Sequence[MagnescaleMG80], read: Read) -> Device:
    (gauge,) = gauges
    unit = "M" if gauge.units == "mm" else "I"

    def answer(command: bytes, show: Show) -> bytes:
        if command != gauge.request.encode():
            return b""
        (value,) = show()
        good = math.isfinite(value)
        header = f"{gauge.address}N{unit}{'G' if good else 'E'}".encode()
        return header + (written(value) if good else b"  Error ") + _END

    return TextDevice(gauges, read, _END, answer)


def _read(data: bytes, gauge: MagnescaleMG80) -> Reading:
    if len(data) != _LENGTH:
        return garbled(data)
    if data[:2] != gauge.address.encode():
        detail = (
            f"counter {data[:2].decode('ascii', 'replace')!r} answered instead of {gauge.address!r}; correct `address`"
        )
        return Trouble(detail, FaultKind.MISSING)
    return value_of(data[2:], gauge)

"""Mahr Millimar C1202: `M1?` requests a single feature, `?` all three, joined with `;` in a single answer.

The answer is `1 ±XXX.XX unit`, followed by up to two of `<` `=` `>` if tolerances are active, or `ERR6` for an inactive
feature (manual of the maker p. 82, confirmed). `channel` is the feature. Each reading contains the unit.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from daq.gauges import Read
from daq.protocol.conversation import Device, FaultKind, Host
from daq.protocol.texts import SIGNED, Reading, Show, TextDevice, Trouble, garbled, in_mm, polled_text
from rigs.schema.gauges import MahrC1202

_END = b"\r"
_FEATURE = re.compile(rb"(?:([123]) )?(?:(ERR\d+)|(" + SIGNED + rb") ([A-Za-z]+)(?: [<=>]){0,2})")
_FORMAT = {"mm": "+09.4f", "um": "+07.2f", "inch": "+09.5f"}


def host(gauges: Sequence[MahrC1202]) -> Host:
    if len(gauges) == 1:
        return polled_text(gauges, b"M%d?" % gauges[0].channel + _END, _END, _read)
    return polled_text(gauges, b"?" + _END, _END, _read_one_of_several)


def device(gauges: Sequence[MahrC1202], read: Read) -> Device:
    """Unassigned features are inactive."""

    def answer(command: bytes, show: Show) -> bytes:
        if command in {b"ID?", b"DES?"}:
            return b"1 C1202" + _END
        asked = {b"?": (1, 2, 3), b"M1?": (1,), b"M2?": (2,), b"M3?": (3,)}.get(command)
        if asked is None:
            return b"ERR1" + _END
        values = dict(zip((gauge.channel for gauge in gauges), show(), strict=True))
        written, units = [], gauges[0].units
        for feature in asked:
            value = values.get(feature, math.nan)
            text = f"{format(value, _FORMAT[units])} {units}" if math.isfinite(value) else "ERR6"
            written.append(f"{feature} {text}".encode())
        return b";".join(written) + _END

    return TextDevice(gauges, read, _END, answer)


def _read(data: bytes, gauge: MahrC1202) -> Reading:
    fields = data.split(b";")
    features = [feature for field in fields if (feature := _FEATURE.fullmatch(field))]
    if len(features) < len(fields):
        return garbled(data)
    for feature in features:
        number, error, value, unit = feature.groups()
        if int(number or gauge.channel) != gauge.channel:
            continue
        if error == b"ERR6":
            return Trouble(f"feature {gauge.channel} is deactivated (ERR6); activate the feature, or correct `channel`")
        if error:
            return Trouble(f"feature {gauge.channel} answers {error.decode()}; see the gauge's manual")
        return in_mm(value, unit, gauge)
    return Trouble(f"feature {gauge.channel} is missing in the answer; correct `channel`", FaultKind.MISSING)


def _read_one_of_several(data: bytes, gauge: MahrC1202) -> Reading:
    """Refuse an answer that has lost a number of a feature, because another feature could be read instead."""
    is_numbered = all(field[:2] in {b"1 ", b"2 ", b"3 "} for field in data.split(b";"))
    return _read(data, gauge) if is_numbered else garbled(data)

"""Magnescale LT20A and LT30: `R` requests all channels. Channel 1 is A, channel 2 is B.

The answer is `A+12.3456`, optionally with letters before the sign: mode (N current, P peak to peak, I minimum, A
maximum), unit (M mm, I inch), comparator (U, G, L, E). `A+F…` is an overflow, `AE` an alarm (LT20A/LT30 manual
p. 100-101, confirmed). A two-channel counter sends B after A and a blank. It can also be configured to send B in a
separate line, which looks like a late answer: configure the blank. `R` and CR LF are taken from the related LT10A
(manual p. 43), and the line settings are unknown: weak.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from daq.gauges import Read
from daq.protocol.conversation import Device, FaultKind, Host
from daq.protocol.texts import CHECK, Reading, Show, TextDevice, Trouble, garbled, in_mm, mm, polled_text
from rigs.schema.gauges import MagnescaleLT
from rigs.schema.probe import Probe

_END = b"\r\n"
_REQUEST = b"R"
_VALUE = re.compile(
    rb"(?:([NPIA])([MI])[UGLE]?)?"
    rb"(?:([+-](?=[\d.]{7}$)\d+\.\d+)|([+-]F[\d.]+|EF)|(EO?| *Error *))"
)
_MODE = {b"P": "peak-to-peak value", b"I": "minimum", b"A": "maximum"}
_UNIT = {b"M": b"mm", b"I": b"inch"}
_CHECK = f"{CHECK}, and that the delimiter is CR LF"


def host(gauges: Sequence[MagnescaleLT]) -> Host:
    return polled_text(gauges, _REQUEST + _END, _END, _read, _CHECK)


def device(gauges: Sequence[MagnescaleLT], read: Read) -> Device:
    """A channel not assigned to a gauge reads zero."""

    def answer(command: bytes, show: Show) -> bytes:
        if command != _REQUEST:
            return b""
        values = dict(zip((gauge.channel for gauge in gauges), show(), strict=True))
        channels = range(1, max(values) + 1)
        return b" ".join(_name(k) + written(values.get(k, 0.0)) for k in channels) + _END

    return TextDevice(gauges, read, _END, answer)


def _read(data: bytes, gauge: MagnescaleLT) -> Reading:
    # A blank may also be part of the text of an alarm, so a channel ends at the start of the next.
    fields = re.split(rb" (?=[AB][NPIAE+-])", data)
    if not all(field[:1] in {b"A", b"B"} and _VALUE.fullmatch(field[1:]) for field in fields):
        return garbled(data)
    for field in fields:
        if field.startswith(_name(gauge.channel)):
            return value_of(field[1:], gauge)
    name = _name(gauge.channel).decode()
    return Trouble(
        f"channel {name} is missing in the answer; add the channel to the output of the counter, or correct `channel`",
        FaultKind.MISSING,
    )


def value_of(field: bytes, gauge: Probe) -> Reading:
    match = _VALUE.fullmatch(field)
    if not match:
        return garbled(field)
    mode, unit, number, overflow, alarm = match.groups()
    if overflow:
        return Trouble("the counter overflows; bring the probe into the range and reset the counter")
    if alarm:
        return Trouble("the counter reports an alarm; check the probe's connection and reset the counter")
    if mode in _MODE:
        return Trouble(f"the counter shows the {_MODE[mode]}; switch to the current value")
    return in_mm(number, _UNIT[unit], gauge) if unit else mm(number, gauge)


def written(value: float) -> bytes:
    """A number in the notation of the counter: sign and seven characters, or an overflow or alarm."""
    if not math.isfinite(value):
        return b"E"
    return f"{value:+08.4f}".encode() if abs(value) < 99.99995 else b"+F0.0000"


def _name(channel: int) -> bytes:
    return b"AB"[channel - 1 : channel]

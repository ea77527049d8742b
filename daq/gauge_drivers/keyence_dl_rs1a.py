"""Keyence DL-RS1A with GT2 heads: `M0` requests all heads together, starting with the main unit.

The answer is `M0,-00.007,+00.018` (seen on a wire with two heads, confirmed). `ER,<command>,<number>` is a refusal,
with numbers up to 29 from the DL-RS1A/GT2 manual p. 14 (confirmed by its text) and 65 to 67 from manuals of other
amplifiers on the same unit (weak).

A head out of range returns a number: all nines, or `-99.998` if it has no value (DL-RS1A/SK-1000 manual p. 11, which
also gives `+EE.EEE` for an amplifier error; weak for GT2, because the table was not available). M0 returns a buffer
refreshed periodically: readings are older than the request by a cycle.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from daq.gauges import Read
from daq.protocol.conversation import Device, FaultKind, Host
from daq.protocol.polled import Then
from daq.protocol.texts import SIGNED, Reading, Show, TextDevice, Trouble, mm, polled_text, printable_message
from rigs.schema.gauges import KeyenceDLRS1A

_END = b"\r\n"
_NUMBER = re.compile(SIGNED)
_NO_VALUE = re.compile(rb"[+-]9+\.9+|-9+\.9+8")
_ERRORS = {
    b"00": "invalid command; check that the device is a DL-RS1A",
    b"02": "no contact between DL-RS1A and amplifier; wait until the amplifiers have started",
    b"20": "wrong length of data; check the line settings",
    b"21": "wrong number of parameters; check the line settings",
    b"22": "parameter error; check the amplifiers' settings",
    b"29": "error on the RS-232C line; check the line settings against the DL-RS1A's switches",
    b"65": "wrong ID number; check the amplifiers' connection",
    b"66": "no contact on the expansion line; check the amplifiers' connection",
    b"67": "not writable; set the DL-RS1A's switch to R/W",
}
_FORMAT = {"mm": "+07.3f", "um": "+08.1f", "inch": "+08.5f"}
_CHECK = "check the cable and the power supply, and compare the line settings with the switches of the DL-RS1A"


def host(gauges: Sequence[KeyenceDLRS1A]) -> Host:
    # A unit with no heads returns the request.
    return polled_text(gauges, b"M0" + _END, _END, _read, _CHECK, may_echo=False)


def device(gauges: Sequence[KeyenceDLRS1A], read: Read) -> Device:
    """Emulated unit with heads up to the last channel used. A head not assigned to a gauge reads zero."""
    form = _FORMAT[gauges[0].units]

    def answer(command: bytes, show: Show) -> bytes:
        if not command:
            return b"ER,,20" + _END
        if command != b"M0":
            return b"ER," + command.split(b",")[0][:2] + b",00" + _END
        fields = [format(0.0, form)] * max(gauge.channel for gauge in gauges)
        for gauge, value in zip(gauges, show(), strict=True):
            fields[gauge.channel - 1] = format(value, form) if math.isfinite(value) else "+EE.EEE"
        return b"M0," + ",".join(fields).encode() + _END

    return TextDevice(gauges, read, _END, answer)


def _read(data: bytes, gauge: KeyenceDLRS1A) -> Reading:
    name, *fields = data.split(b",")
    if name == b"ER" and len(fields) == 2:
        return Trouble(
            f"{printable_message(data)}: {_ERRORS.get(fields[1], 'unknown error number; see the DL-RS1A manual')}"
        )
    if name != b"M0":
        detail = f"{printable_message(data)} is not an answer to M0; check the line settings"
        return Trouble(detail, FaultKind.GARBLED, Then.DRAIN)
    field = fields[gauge.channel - 1] if gauge.channel <= len(fields) else b""
    if not field:
        detail = f"no head on channel {gauge.channel}, {len(fields)} answer; check the amplifiers and `channel`"
        return Trouble(detail, FaultKind.MISSING)
    if not _NUMBER.fullmatch(field) or _NO_VALUE.fullmatch(field):
        return Trouble(
            f"channel {gauge.channel} shows {printable_message(field)}: out of range or in error; check the head"
        )
    return mm(field, gauge, len(fields))

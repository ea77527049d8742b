"""Text lines printed by a user program on the controller, a sample per line: KAREL or any program with sockets.

Fields, units and separators are configured, because there is no standard. On a serial port the first line may be
incomplete and still appear valid, so it is discarded. A datagram contains complete lines; delayed ones are recognised
by their clock. If the field of the signal or of the condition is empty, the value is nan, which means unknown.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

from daq.feedback import Read
from daq.protocol.conversation import Device, FaultKind, Host
from daq.protocol.framing import DelimitedLines
from daq.protocol.numerals import number, plausible
from daq.protocol.positions import ClockOrder, DatagramLines, Position, Positions, SteadyDevice, UnusableDatagram
from daq.protocol.streamed import Streamed
from rigs.schema.condition import CONDITION
from rigs.schema.feedback import ASKED_INSTEAD, CLOCK_FIELDS, SIGNAL, LineFeed, columns_beside_joints
from rigs.schema.links import tcp_address, udp_address

RATE_HZ = 100.0
"""Of the emulated controller: an unconfirmed estimate for a KAREL task. The host assumes no rate."""
_LEFT_OUT = {"_": 0.0} | dict.fromkeys((SIGNAL, *CONDITION), math.nan)
_CLOCK_S = {"t_s": 1.0, "t_ms": 1e-3, "t_us": 1e-6}
_CLOCK_FORMAT = {"t_s": ".3f", "t_ms": ".0f", "t_us": ".0f"}


def host(feedback: LineFeed) -> Host:
    by_tcp, by_udp = tcp_address(feedback.port) is not None, udp_address(feedback.port) is not None
    calls = f", and that the program connects to {feedback.port}" if feedback.listens else ""
    asked = ASKED_INSTEAD if by_tcp and not feedback.listens else ""
    check = f"check that the program on the controller is running{calls}{asked}"
    frames = DatagramLines() if by_udp else DelimitedLines(b"\n", joined_midway=not by_tcp)
    order = ClockOrder(repeats=True) if by_udp else None
    decode = partial(_decode, feedback, columns_beside_joints(feedback))
    return Streamed(Positions(decode, check, order, frames=frames), feedback.timeout_s)


def device(feedback: LineFeed, read: Read) -> Device:
    return _ControllerProgram(feedback, read)


def _decode(feedback: LineFeed, beside: Sequence[str], data: bytes) -> Position | UnusableDatagram:
    # Repeated blanks count as a single separator.
    separator = None if feedback.separator.isspace() else feedback.separator
    parts = data.decode("ascii", "replace").strip().split(separator)
    if len(parts) != len(feedback.fields):
        return _garbled(data, f"has {len(parts)} fields instead of {len(feedback.fields)}")
    read: dict[str, float] = {}
    for name, part in zip(feedback.fields, map(str.strip, parts), strict=True):
        value = _LEFT_OUT.get(name) if not part or name == "_" else number(part)
        if value is None:
            return _garbled(data, f"has an invalid number {name} = {part[:40]!r}")
        read[name] = value
    angles_deg = [
        read[f"q{axis}_deg"] if f"q{axis}_deg" in read else math.degrees(read[f"q{axis}_rad"]) for axis in range(1, 7)
    ]
    clock_s = next((read[name] * _CLOCK_S[name] for name in read if name in CLOCK_FIELDS), math.nan)
    return Position(angles_deg, clock_s, condition=tuple(plausible(read[name]) for name in beside))


def _garbled(data: bytes, why: str) -> UnusableDatagram:
    return UnusableDatagram(FaultKind.GARBLED, f"line {data[:80]!r} {why}; check `fields` and `separator`")


class _ControllerProgram(SteadyDevice):
    """Program on the controller. Its clock starts at zero when the link opens."""

    IS_STREAM = True

    def __init__(self, feedback: LineFeed, read: Read) -> None:
        super().__init__(read, RATE_HZ)
        self._feedback = feedback
        self._beside = columns_beside_joints(feedback)

    def _message(self, instant_ns: int) -> bytes:
        shown = self._read(instant_ns)
        parts = []
        for name in self._feedback.fields:
            if name == "_":
                parts.append("0")
            elif name in CLOCK_FIELDS:
                clock = (instant_ns - self._connected_ns) * 1e-9 / _CLOCK_S[name]
                parts.append(format(clock, _CLOCK_FORMAT[name]))
            elif name in self._beside:
                parts.append(format(shown[6 + self._beside.index(name)], "g"))
            else:
                angle = shown[int(name[1]) - 1]
                parts.append(f"{angle:.5f}" if name.endswith("_deg") else f"{math.radians(angle):.7f}")
        return (self._feedback.separator.join(parts) + "\r\n").encode()

"""Text lines printed by a user program on the controller, a sample per line: KAREL or any program with sockets.

Fields, units and separators are configured, because there is no standard. A line that does not match the configured
fields is GARBLED. The host sends no data. On a serial port the first line may be incomplete and still appear valid, so
it is discarded. A datagram contains complete lines. Delayed datagrams are recognised by their clock and ignored (LATE).
`signal` is a program number, for example 0 for none. If the field of the signal or of the condition is empty, the value
is nan, which means unknown.

The emulated controller prints `RATE_HZ` lines a second. This is an unconfirmed estimate for a KAREL task that reads the
joints and writes to a socket in a loop. The host assumes no rate.
"""

from __future__ import annotations

import math

from daq.feedback import Read
from daq.protocol.conversation import NO_TIME, Device, Fault, FaultKind, Host, Sample
from daq.protocol.framing import DelimitedLines, Framer, Message
from daq.protocol.numerals import are_angles, number, plausible
from daq.protocol.positions import DatagramLines, SteadyDevice
from daq.protocol.streamed import Reaction, Streamed
from rigs.schema.condition import CONDITION
from rigs.schema.feedback import ASKED_INSTEAD, CLOCK_FIELDS, SIGNAL, LineFeed, columns_beside_joints
from rigs.schema.links import tcp_address, udp_address

RATE_HZ = 100.0
_BEHIND_S = 1.0
"""Smallest backward step of the clock after a restart of the program. Network delays are shorter."""
_LEFT_OUT = {"_": 0.0} | dict.fromkeys((SIGNAL, *CONDITION), math.nan)
_CLOCK_S = {"t_s": 1.0, "t_ms": 1e-3, "t_us": 1e-6}
_CLOCK_FORMAT = {"t_s": ".3f", "t_ms": ".0f", "t_us": ".0f"}


def host(feedback: LineFeed) -> Host:
    """Host side of the protocol, which reads the joint angles in degrees."""
    return Streamed(_LineFeedDialect(feedback), feedback.timeout_s)


def device(feedback: LineFeed, read: Read) -> Device:
    """Emulated controller, the device side of the protocol. `read` gives joint angles in degrees."""
    return _ControllerProgram(feedback, read)


class _LineFeedDialect:
    def __init__(self, feedback: LineFeed) -> None:
        calls = f", and that the program connects to {feedback.port}" if feedback.listens else ""
        asked = ASKED_INSTEAD if tcp_address(feedback.port) and not feedback.listens else ""
        self.check = f"check that the program on the controller is running{calls}{asked}"
        self._last_clock_s = -math.inf
        self._may_be_late = udp_address(feedback.port) is not None
        self.frames: Framer = (
            DatagramLines()
            if self._may_be_late
            else DelimitedLines(b"\n", joined_midway=tcp_address(feedback.port) is None)
        )
        self._fields = feedback.fields
        self._beside = columns_beside_joints(feedback)
        # Repeated blanks count as a single separator.
        self._separator = None if feedback.separator.isspace() else feedback.separator

    def start(self) -> bytes:
        return b""

    def silent(self) -> Reaction:
        return Reaction()

    def read(self, message: Message | Fault) -> Reaction:
        if isinstance(message, Fault):
            return Reaction((message,))
        parts = message.data.decode("ascii", "replace").strip().split(self._separator)
        if len(parts) != len(self._fields):
            return _garbled(message, f"has {len(parts)} fields instead of {len(self._fields)}")
        read: dict[str, float] = {}
        for name, part in zip(self._fields, map(str.strip, parts), strict=True):
            value = _LEFT_OUT.get(name) if not part or name == "_" else number(part)
            if value is None:
                return _garbled(message, f"has an invalid number {name} = {part[:40]!r}")
            read[name] = value
        angles_deg = (
            read[f"q{axis}_deg"] if f"q{axis}_deg" in read else math.degrees(read[f"q{axis}_rad"])
            for axis in range(1, 7)
        )
        clock_s = [read[name] * _CLOCK_S[name] for name in read if name in CLOCK_FIELDS]
        sample = Sample(
            (*angles_deg, *(plausible(read[name]) for name in self._beside)),
            NO_TIME,
            message.first_byte_ns,
            message.last_byte_ns,
            message.size,
            clock_s[0] if clock_s else math.nan,
        )
        if not are_angles(sample.values[:6]):
            return _garbled(message, "has an impossible angle")
        if self._may_be_late and 0 < self._last_clock_s - sample.device_time_s < _BEHIND_S:
            detail = f"line with clock {sample.device_time_s:g} s came after a later one; ignored; check the network"
            return Reaction((Fault(FaultKind.LATE, message.last_byte_ns, detail),))
        self._last_clock_s = sample.device_time_s
        return Reaction((sample,))


def _garbled(message: Message, why: str) -> Reaction:
    detail = f"line {message.data[:80]!r} {why}; check `fields` and `separator`"
    return Reaction((Fault(FaultKind.GARBLED, message.last_byte_ns, detail),))


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

"""The example arm: a datagram of 38 bytes a position, 250 times a second, and no answer.

A controller that does not exist, for docs/how-to/add-a-robot-interface.md. Big-endian: the letters AR, the number of
the datagram (u32, wraps), the controller's clock in µs since it was switched on (u64), six angles in degrees (f32).
"""

from __future__ import annotations

import struct

from daq.feedback import Read
from daq.protocol.conversation import Device, FaultKind, Host, Step
from daq.protocol.positions import Order, Pace, Position, Positions, Refused
from daq.protocol.streamed import Streamed
from rigs.schema.example_arm import ExampleArm

RATE_HZ = 250.0
_POSITION = struct.Struct(">2sIQ6f")
_MAGIC = b"AR"
_CHECK = "check that the controller streams, and that it sends to this address"


def host(feedback: ExampleArm) -> Host:
    """Return our side of the conversation."""
    return Streamed(Positions(_decode, _CHECK, Order()), feedback.timeout_s)


def device(feedback: ExampleArm, read: Read) -> Device:
    """Return the controller's side of the conversation."""
    return _Controller(read)


def _decode(data: bytes) -> Position | Refused:
    if len(data) != _POSITION.size or not data.startswith(_MAGIC):
        return Refused(FaultKind.GARBLED, f"{data[:16].hex(' ')} is no position of an example arm")
    _, number, clock_us, *angles_deg = _POSITION.unpack(data)
    return Position(tuple(angles_deg), clock_us * 1e-6, number)


class _Controller:
    """The controller, which is switched on when the link opens."""

    def __init__(self, read: Read) -> None:
        self.sent = 0
        self._read = read
        self._start_ns = 0
        self._pace = Pace(RATE_HZ, 0)

    def connected(self, now_ns: int) -> Step:
        self._start_ns = now_ns
        self._pace = Pace(RATE_HZ, now_ns)
        return Step(wake_ns=now_ns)

    def received(self, data: bytes, now_ns: int) -> Step:
        return Step(wake_ns=self._pace.next_ns)

    def tick(self, now_ns: int) -> Step:
        """Send one datagram; a tick that is late is followed by the next at once."""
        instant_ns = self._pace.step(now_ns)
        send = b"" if instant_ns is None else self._datagram(instant_ns)
        return Step(send, wake_ns=self._pace.next_ns)

    def _datagram(self, instant_ns: int) -> bytes:
        clock_us = round((instant_ns - self._start_ns) / 1000)
        data = _POSITION.pack(_MAGIC, self.sent % 2**32, clock_us, *self._read(instant_ns))
        self.sent += 1
        return data

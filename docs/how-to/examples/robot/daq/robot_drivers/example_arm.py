"""The example arm: a datagram of 38 bytes a position, 250 times a second, and no answer.

A controller that does not exist, for docs/how-to/add-a-robot-interface.md. Big-endian: the letters AR, the number of
the datagram (u32, wraps), the controller's clock in µs since it was switched on (u64), six angles in degrees (f32).
"""

from __future__ import annotations

import struct

from daq.feedback import Read
from daq.protocol.conversation import Device, FaultKind, Host
from daq.protocol.positions import Order, Position, Positions, SteadyDevice, UnusableDatagram
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
    return _Controller(read, RATE_HZ)


def _decode(data: bytes) -> Position | UnusableDatagram:
    if len(data) != _POSITION.size or not data.startswith(_MAGIC):
        return UnusableDatagram(FaultKind.GARBLED, f"{data[:16].hex(' ')} is no position of an example arm")
    _, number, clock_us, *angles_deg = _POSITION.unpack(data)
    return Position(tuple(angles_deg), clock_us * 1e-6, number)


class _Controller(SteadyDevice):
    """The controller, which is switched on when the link opens."""

    def _message(self, instant_ns: int) -> bytes:
        clock_us = round((instant_ns - self._connected_ns) / 1000)
        return _POSITION.pack(_MAGIC, self.sent % 2**32, clock_us, *self._read(instant_ns))

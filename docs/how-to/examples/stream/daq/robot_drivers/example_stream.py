"""The example stream: over TCP a message of 36 bytes a position, 100 times a second, and no answer.

A controller that does not exist, for docs/how-to/add-a-robot-interface.md. Big-endian: the letters JP, the length of
the message in bytes (u16), the controller's clock in µs since it was switched on (u64), six angles in degrees (f32).
"""

from __future__ import annotations

import struct

from daq.feedback import Read
from daq.protocol.conversation import Device, Fault, Host
from daq.protocol.framing import Sized
from daq.protocol.positions import Position, Positions, SteadyDevice
from daq.protocol.streamed import Reaction, Streamed
from rigs.schema.example_stream import ExampleStream

RATE_HZ = 100.0
_HEADER = struct.Struct(">2sH")
_POSITION = struct.Struct(">2sHQ6f")
_MAGIC = b"JP"


def host(feedback: ExampleStream) -> Host:
    """Return our side of the conversation."""
    return Streamed(_Stream(), feedback.timeout_s)


def device(feedback: ExampleStream, read: Read) -> Device:
    """Return the controller's side of the conversation."""
    return _Controller(read, RATE_HZ)


def _length(header: bytes) -> int | None:
    """Return the length of a message by its first bytes; None where they begin no message."""
    magic, length = _HEADER.unpack(header)
    return length if (magic, length) == (_MAGIC, _POSITION.size) else None


class _Stream(Positions):
    def __init__(self) -> None:
        check = "check that the controller is on and that its server runs"
        super().__init__(_decode, check, order=None, frames=Sized(_HEADER.size, _length))

    def silent(self) -> Reaction:
        return Reaction(hang_up=True)

    def garbled(self, fault: Fault) -> Reaction:
        return Reaction((fault,), hang_up=True)


def _decode(data: bytes) -> Position:
    _, _, clock_us, *angles_deg = _POSITION.unpack(data)
    return Position(angles_deg, clock_us * 1e-6)


class _Controller(SteadyDevice):
    """The controller, which is switched on when the link opens."""

    IS_STREAM = True

    def _message(self, instant_ns: int) -> bytes:
        clock_us = round((instant_ns - self._connected_ns) / 1000)
        return _POSITION.pack(_MAGIC, _POSITION.size, clock_us, *self._read(instant_ns))

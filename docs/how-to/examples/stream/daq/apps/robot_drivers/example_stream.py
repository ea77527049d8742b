"""The example stream: over TCP a message of 36 bytes a position, 100 times a second, and no answer.

A controller that does not exist, for docs/how-to/add-a-robot-interface.md. Big-endian: the letters JP, the length of
the message in bytes (u16), the controller's clock in µs since it was switched on (u64), six angles in degrees (f32).
"""

from __future__ import annotations

import struct

from daq.feedback import Read
from daq.protocol.conversation import NO_TIME, Device, Fault, FaultKind, Host, Sample
from daq.protocol.framing import Message, Sized
from daq.protocol.numerals import are_angles
from daq.protocol.positions import SteadyDevice
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


class _Stream:
    check = "check that the controller is on and that its server runs"

    def __init__(self) -> None:
        self.frames = Sized(_HEADER.size, _length)

    def start(self) -> bytes:
        return b""

    def silent(self) -> Reaction:
        return Reaction(hang_up=True)

    def read(self, message: Message | Fault) -> Reaction:
        if isinstance(message, Fault):
            return Reaction((message,), hang_up=True)
        _, _, clock_us, *angles_deg = _POSITION.unpack(message.data)
        at_ns = message.last_byte_ns
        if not are_angles(angles_deg):
            return Reaction((Fault(FaultKind.GARBLED, at_ns, f"angles {angles_deg}; left out"),))
        sample = Sample(tuple(angles_deg), NO_TIME, message.first_byte_ns, at_ns, message.size, clock_us * 1e-6)
        return Reaction((sample,))


class _Controller(SteadyDevice):
    """The controller, which is switched on when the link opens."""

    IS_STREAM = True

    def _message(self, instant_ns: int) -> bytes:
        clock_us = round((instant_ns - self._connected_ns) / 1000)
        return _POSITION.pack(_MAGIC, _POSITION.size, clock_us, *self._read(instant_ns))

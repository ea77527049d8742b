"""FANUC Stream Motion (J519), its status packets only (manual B-84904EN as public clients quote it; see origin).

One packet of 8 bytes asks the controller for its status, type 0 and version 1; from then on it sends 132 bytes each
cycle of 8 ms (some 4 or 2), to where the request came from. Big-endian: type, version, number; status, io type; io
index, mask, value; time stamp; 9 × pose, 9 × joints, 9 × currents. The request is sent again while nothing comes,
and is all that is ever sent: no motion, no program needed.

The stamp is 32 bits of ms; it wraps after 49 days, and the analysis fits it in pieces.
"""

from __future__ import annotations

import struct

from daq.feedback import Read
from daq.protocol.conversation import Device, FaultKind, Host, Step
from daq.protocol.order import Order
from daq.protocol.pace import Pace
from daq.protocol.positions import Position, Positions, Refused
from daq.protocol.streamed import Streamed
from rigs.schema.feedback import FANUCStreamMotion

RATE_HZ = 125.0
_REQUEST = struct.Struct(">II")
_STATUS = struct.Struct(">IIIBBHHHI27f")
START, STOP = _REQUEST.pack(0, 1), _REQUEST.pack(2, 1)


def host(feedback: FANUCStreamMotion) -> Host:
    """Return our side of the conversation."""
    check = "check the address, the cable and that option J519 is there; another client may have the stream"
    return Streamed(Positions(_decode, check, Order(), START), feedback.timeout_s)


def device(feedback: FANUCStreamMotion, read: Read) -> Device:
    """Return the controller's side of the conversation."""
    return _StreamMotionController(read)


def _decode(data: bytes) -> Position | Refused:
    if len(data) != _STATUS.size:
        return Refused(FaultKind.GARBLED, f"a status of version 1 has {_STATUS.size}; check what is at this address")
    kind, _, number, _, _, _, _, _, stamp_ms, *pose_joints_currents = _STATUS.unpack(data)
    if kind != 0:
        return Refused(FaultKind.GARBLED, f"packet of type {kind} where 0, a status, is expected")
    return Position(tuple(pose_joints_currents[9:15]), stamp_ms / 1000, number)


class _StreamMotionController:
    """The controller: the status each cycle, from the request on until it is asked to stop."""

    STAMP_START_MS = 86_400_000

    def __init__(self, read: Read) -> None:
        self.sent = 0
        self._read = read
        self._connected_ns = 0
        self._pace: Pace | None = None

    def connected(self, now_ns: int) -> Step:
        self._connected_ns = now_ns
        return Step()

    def received(self, data: bytes, now_ns: int) -> Step:
        if data == START and self._pace is None:
            self._pace = Pace(RATE_HZ, now_ns)
        elif data == STOP:
            self._pace = None
        return self._step(b"")

    def tick(self, now_ns: int) -> Step:
        """Send one packet; a tick that is late is followed by the next at once."""
        instant_ns = self._pace.step(now_ns) if self._pace else None
        return self._step(b"" if instant_ns is None else self._status(instant_ns))

    def _step(self, send: bytes) -> Step:
        return Step(send, wake_ns=self._pace.next_ns if self._pace else None)

    def _status(self, instant_ns: int) -> bytes:
        stamp_ms = self.STAMP_START_MS + round((instant_ns - self._connected_ns) / 1e6)
        joints = [*self._read(instant_ns), 0.0, 0.0, 0.0]
        numbers = (0, 1, self.sent % 2**32, 0, 0, 0, 0, 0, stamp_ms % 2**32)
        self.sent += 1
        return _STATUS.pack(*numbers, *[0.0] * 9, *joints, *[0.0] * 9)

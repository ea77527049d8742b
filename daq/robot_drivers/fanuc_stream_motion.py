"""FANUC Stream Motion (J519), status packets only, versions 1 to 4 (sources: origin of the interface).

The host requests the version of the controller (type 7, *get capability*), and then the status, by a start packet of 8
bytes: type 0 up to version 2, and 200 from version 3 on. The controller then sends a packet every cycle of 8 ms (some
models 4 or 2 ms) to the source of the request, big-endian:

- versions 1 and 2, type 0, 132 bytes: type, version, number; status, io type; io index, mask, value; time stamp; 9 ×
  pose, 9 × joints, 9 × currents;
- version 3, type 202, 388 bytes: type, version, number; four bytes of status; time stamp; the same 27 numbers; safety
  scale; 256 bytes of inputs and outputs;
- version 4, type 204, 416 bytes: as version 3, with forces, moments and sensor before the inputs and outputs.

Until the first answer, the version request alternates with the start packet of version 1, because old controllers do
not support the version request. The host never commands a motion.

Condition: bit 2 of the first status byte is SYSRDY, servo power. From version 3 on, the second byte has an error in bit
0 and the emergency stop in bit 2. The third byte is the contact stop: 2 STOP, 4 ESCP (the arm must be moved out of
contact). The time stamp of 32 bits of ms wraps after 49 days; the analysis fits it piecewise.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from functools import partial

from daq.feedback import Read
from daq.protocol.conversation import ConversationStep, Device, FaultKind, Host
from daq.protocol.framing import Message
from daq.protocol.numerals import plausible
from daq.protocol.positions import Order, Position, Positions, SteadyDevice, SteadyRate, UnusableDatagram
from daq.protocol.streamed import Reaction, Streamed
from rigs.schema.condition import SafetyState
from rigs.schema.feedback import FANUCStreamMotion

RATE_HZ = 125.0
NEWEST = 4
_ASKED_AS = 3
"""Version stated in the request, as in FANUC's driver."""
_REQUEST = struct.Struct(">II")
_CAPABILITY = struct.Struct(">7I")
"""Type, version and number of the request, sampling rate in ms, steps before a motion, version, tool pose flag. In
the answer of some controllers the last field is a single byte.
"""
_SHORT_CAPABILITY = _CAPABILITY.size - 3
_ASK_CAPABILITY = 7
_STATUS = {
    0: struct.Struct(">IIIBBHHHI27f"),
    202: struct.Struct(">IIIBBBBI27ff256s"),
    204: struct.Struct(">IIIBBBBI27f7fI256s"),
}
_STAMP = {0: 8, 202: 7, 204: 7}
"""Index of the time stamp in each layout. The 27 numbers follow it."""
_BYTES_OF_STATE = 3
_SYSRDY, _ERROR, _E_STOP = 4, 1, 4
_CONTACT = {2: SafetyState.PROTECTIVE_STOP, 4: SafetyState.RECOVERY}
STOP = _REQUEST.pack(2, 1)
ASK_VERSION = _CAPABILITY.pack(_ASK_CAPABILITY, _ASKED_AS, 1, 0, 0, 0, 0)


def start_packet(version: int) -> bytes:
    return _REQUEST.pack(0 if version < 3 else 200, version)


def host(feedback: FANUCStreamMotion) -> Host:
    return Streamed(_StreamMotionClient(feedback), feedback.timeout_s)


def device(feedback: FANUCStreamMotion, read: Read) -> Device:
    return _StreamMotionController(feedback.version or _ASKED_AS, read)


def _decode(currents: bool, data: bytes) -> Position | UnusableDatagram:
    kind = int.from_bytes(data[:4], "big")
    layout = _STATUS.get(kind)
    if layout is None:
        return UnusableDatagram(FaultKind.GARBLED, f"packet of type {kind} instead of a status (0, 202 or 204)")
    if len(data) != layout.size:
        return UnusableDatagram(
            FaultKind.GARBLED, f"status of type {kind} with {layout.size} bytes; check the device at this address"
        )
    fields = layout.unpack(data)
    place = _STAMP[kind]
    state, robot, contact = fields[_BYTES_OF_STATE : _BYTES_OF_STATE + 3]
    drawn = map(plausible, fields[place + 19 : place + 25]) if currents else ()
    gravest = _CONTACT.get(contact, SafetyState.FAULT if robot & _ERROR else SafetyState.NORMAL)
    gravest = SafetyState.EMERGENCY_STOP if robot & _E_STOP else gravest
    safety = math.nan if kind == 0 else float(gravest)
    condition = (safety, float(bool(state & _SYSRDY)), *drawn)
    return Position(fields[place + 10 : place + 16], fields[place] / 1000, fields[2], condition)


def _nine(values: Sequence[float]) -> list[float]:
    return [*values, *[0.0] * (9 - len(values))]


class _StreamMotionClient(Positions):
    def __init__(self, feedback: FANUCStreamMotion) -> None:
        check = (
            "check the address, the cable and that option J519 is there; another client may have the stream; or state"
        )
        super().__init__(partial(_decode, feedback.currents), f"{check} the controller's `version`", Order())
        self._version = feedback.version
        self._answered = False
        self._asked = False

    def start(self) -> bytes:
        if self._version is not None:
            return start_packet(self._version)
        self._asked = self._answered or not self._asked
        return ASK_VERSION if self._asked else start_packet(1)

    def silent(self) -> Reaction:
        super().silent()
        return Reaction(send=self.start())

    def read(self, message: Message) -> Reaction:
        if message.data[:4] != ASK_VERSION[:4]:
            return super().read(message)
        if len(message.data) not in (_CAPABILITY.size, _SHORT_CAPABILITY):
            detail = f"datagram of {message.size} bytes; a version answer has {_CAPABILITY.size}"
            return Reaction((message.fault(FaultKind.GARBLED, detail),))
        self._answered = True
        available = int.from_bytes(message.data[20:24], "big")
        return Reaction(send=start_packet(max(1, min(available, NEWEST))))


class _StreamMotionController(SteadyDevice):
    STAMP_START_MS = 86_400_000
    SAMPLING_MS = 8

    def __init__(self, version: int, read: Read) -> None:
        super().__init__(read)
        self._version = version

    def received(self, data: bytes, now_ns: int) -> ConversationStep:
        if self._version > 1 and len(data) == _CAPABILITY.size and data[:4] == ASK_VERSION[:4]:
            answer = _CAPABILITY.pack(_ASK_CAPABILITY, self._version, 1, self.SAMPLING_MS, 1, self._version, 0)
            return self._step(answer[:_SHORT_CAPABILITY] if self._version == 2 else answer)
        if data == start_packet(self._version) and self._pace is None:
            self._pace = SteadyRate(RATE_HZ, now_ns)
        elif len(data) == _REQUEST.size and data[:4] == STOP[:4]:
            self._pace = None
        return self._step()

    def _message(self, instant_ns: int) -> bytes:
        stamp_ms = (self.STAMP_START_MS + round((instant_ns - self._connected_ns) / 1e6)) % 2**32
        shown = self._read(instant_ns)
        safety, motors = shown[6:8]
        contact = next((code for code, state in _CONTACT.items() if state == safety), 0)
        robot = {SafetyState.EMERGENCY_STOP: _E_STOP, SafetyState.FAULT: _ERROR}.get(SafetyState(int(safety)), 0)
        state = _SYSRDY if motors else 0, robot, contact
        numbers = [*[0.0] * 9, *_nine(shown[:6]), *_nine(shown[8:])]
        kind = 0 if self._version < 3 else 202 if self._version == 3 else 204
        head = (kind, self._version, self.sent % 2**32)
        if kind == 0:
            return _STATUS[kind].pack(*head, state[0], 0, 0, 0, 0, stamp_ms, *numbers)
        forces = () if kind == 202 else (*[0.0] * 6, 0xFFFFFFFF)
        return _STATUS[kind].pack(*head, *state, 0, stamp_ms, *numbers, 1.0, *forces, bytes(256))

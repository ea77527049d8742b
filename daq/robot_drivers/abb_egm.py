"""ABB Externally Guided Motion, position stream (ABB's public egm.proto): a Protocol Buffers message per datagram.

The controller sends `EgmRobot` while the program streams (EGMStreamStart), up to 250 times a second. The fields used
are header {1 seqno, 3 mtype} and feedBack {1 joints: measured angles, 4 time: s and µs since 1970}, and for the
condition 4 motorState and 8 rapidExecState, each {1 state}. If `time` is absent, the clock is {2 tm} of the header, 32
bits of ms, which wraps after 49 days; the analysis fits it piecewise. The decoder skips unknown fields; groups (wire
types 3 and 4) are obsolete.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence

from daq.feedback import Read
from daq.protocol.conversation import Device, FaultKind, Host
from daq.protocol.numerals import plausible
from daq.protocol.poses import columns_of, quaternion_of
from daq.protocol.positions import Order, Position, Positions, SteadyDevice, UnusableDatagram
from daq.protocol.streamed import Streamed
from rigs.schema.condition import POSE, ProgramState
from rigs.schema.feedback import ABBEGM

VARINT, FIXED64, BYTES, FIXED32 = 0, 1, 2, 5
_SIZE = {FIXED64: 8, FIXED32: 4}
_LONGEST_VARINT = 10

Field = tuple[int, int, int | bytes]
"""Number, wire type, and value: an integer for a varint, otherwise bytes."""


def fields(data: bytes) -> list[Field] | None:
    message: list[Field] = []
    at = 0
    while at < len(data):
        key, at = _varint(data, at)
        number, wire_type = key >> 3, key & 7
        value: int | bytes
        if wire_type == VARINT:
            value, at = _varint(data, at)
        else:
            size = _SIZE.get(wire_type, -1)
            if wire_type == BYTES:
                size, at = _varint(data, at)
            if size < 0:
                return None
            value, at = data[at : at + size], at + size
        if number < 1 or at > len(data):
            return None
        message.append((number, wire_type, value))
    return message


def _varint(data: bytes, at: int) -> tuple[int, int]:
    """Value and end, which is beyond the data if the varint is truncated or overlong."""
    value = 0
    for index, byte in enumerate(data[at : at + _LONGEST_VARINT]):
        value |= (byte & 0x7F) << 7 * index
        if byte < 0x80:
            return value, at + index + 1
    return 0, len(data) + 1


def number_in(message: Sequence[Field], number: int) -> int:
    values = [value for key, wire_type, value in message if key == number and wire_type == VARINT]
    return int(values[-1]) if values else 0


def message_in(message: Sequence[Field], number: int) -> list[Field] | None:
    parts = [value for key, wire_type, value in message if key == number and wire_type == BYTES]
    return fields(b"".join(part for part in parts if isinstance(part, bytes)))


def doubles_in(message: Sequence[Field], number: int) -> tuple[float, ...]:
    values = [packed for key, wire_type, packed in message if key == number and wire_type in (FIXED64, BYTES)]
    data = b"".join(packed for packed in values if isinstance(packed, bytes))
    return struct.unpack(f"<{len(data) // 8}d", data[: len(data) // 8 * 8])


def varint(value: int) -> bytes:
    low, high = value & 0x7F, value >> 7
    return bytes([low | 0x80]) + varint(high) if high else bytes([low])


def integer(number: int, value: int) -> bytes:
    return varint(number << 3 | VARINT) + varint(value)


def nested(number: int, content: bytes) -> bytes:
    return varint(number << 3 | BYTES) + varint(len(content)) + content


def doubles(number: int, values: Sequence[float]) -> bytes:
    key = varint(number << 3 | FIXED64)
    return b"".join(key + struct.pack("<d", value) for value in values)


RATE_HZ = 250.0
_DATA = 2
_CARTESIAN, _MOTORS, _RAPID = 2, 4, 8
_STATE_OF_MOTORS = {1: 1.0, 2: 0.0}
_STATE_OF_RAPID = {1: ProgramState.STOPPED, 2: ProgramState.RUNNING}


def host(feedback: ABBEGM) -> Host:
    check = "check that the RAPID program is streaming (EGMStreamStart), and that the controller sends to this address"
    return Streamed(Positions(_decode, check, Order()), feedback.timeout_s)


def device(feedback: ABBEGM, read: Read) -> Device:
    return _EGMController(read, RATE_HZ)


def _decode(data: bytes) -> Position | UnusableDatagram:
    message = fields(data)
    header = None if message is None else message_in(message, 1)
    feedback = None if message is None else message_in(message, 2)
    joints = None if feedback is None else message_in(feedback, 1)
    clock = None if feedback is None else message_in(feedback, 4)
    if not message or header is None or joints is None or clock is None or number_in(header, 3) != _DATA:
        return UnusableDatagram(FaultKind.GARBLED, f"{data[:16].hex(' ')} is not an EgmRobot message")
    angles_deg = doubles_in(joints, 1)
    if len(angles_deg) < 6:
        return UnusableDatagram(FaultKind.MISSING, f"{len(angles_deg)} joints instead of 6; check the mechanical unit")
    seconds = number_in(clock, 1) + number_in(clock, 2) * 1e-6 if clock else number_in(header, 2) / 1000
    program, motors = _state_in(message, _RAPID, _STATE_OF_RAPID), _state_in(message, _MOTORS, _STATE_OF_MOTORS)
    condition = (program, motors, *_pose_in(message_in(feedback or [], _CARTESIAN) or []))
    return Position(angles_deg[:6], seconds, number_in(header, 1) % 2**32, condition)


def _pose_in(cartesian: Sequence[Field]) -> tuple[float, ...]:
    """Columns of a position in mm (field 1) and a quaternion (2); nan if a number is missing."""
    numbers = list[float]()
    for part, count in ((1, 3), (2, 4)):
        message = message_in(cartesian, part) or []
        numbers += [values[-1] for key in range(1, count + 1) if (values := doubles_in(message, key))]
    if len(numbers) != 7 or not any(numbers[3:]):
        return (math.nan,) * len(POSE)
    return tuple(map(plausible, columns_of(numbers[3:], numbers[:3])))


def _state_in(message: Sequence[Field], number: int, meanings: Mapping[int, float]) -> float:
    return float(meanings.get(number_in(message_in(message, number) or [], 1), math.nan))


def _cartesian(pose: Sequence[float]) -> bytes:
    groups = (pose[:3], quaternion_of(pose[3:]))
    place, turn = (b"".join(doubles(key, [value]) for key, value in enumerate(group, 1)) for group in groups)
    return nested(1, place) + nested(2, turn)


class _EGMController(SteadyDevice):
    EPOCH_S = 1_700_000_000

    def _message(self, instant_ns: int) -> bytes:
        passed_us = round((instant_ns - self._connected_ns) / 1000)
        header = integer(1, self.sent) + integer(2, passed_us // 1000 % 2**32) + integer(3, _DATA)
        shown = self._read(instant_ns)
        (program, motors), pose = shown[6:8], shown[8:]
        joints = nested(1, doubles(1, shown[:6]))
        if math.isfinite(pose[0]):
            joints += nested(_CARTESIAN, _cartesian(pose))
        clock = integer(1, self.EPOCH_S + passed_us // 1_000_000) + integer(2, passed_us % 1_000_000)
        condition = nested(_MOTORS, integer(1, 1 if motors else 2))
        condition += nested(_RAPID, integer(1, 2 if program == ProgramState.RUNNING else 1))
        return nested(1, header) + nested(2, joints + nested(4, clock)) + condition

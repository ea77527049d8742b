"""Protocol Buffers on the wire, as far as reading a few fields of a message takes (public encoding guide).

A message is a list of fields, each a key (number and wire type, as a varint) and a value. A field may come in any
order and unknown ones must be passed over. Groups (wire types 3 and 4) are long gone from the language.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

VARINT, FIXED64, BYTES, FIXED32 = 0, 1, 2, 5
_SIZE = {FIXED64: 8, FIXED32: 4}
_LONGEST_VARINT = 10

Field = tuple[int, int, int | bytes]
"""Number, wire type, and a varint's value or else the bytes."""


def fields(data: bytes) -> list[Field] | None:
    """Return the fields of a message in their order; None if the bytes are not a message."""
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
    """Value and where it ends; an end beyond the data for one that is cut off or too long."""
    value = 0
    for index, byte in enumerate(data[at : at + _LONGEST_VARINT]):
        value |= (byte & 0x7F) << 7 * index
        if byte < 0x80:
            return value, at + index + 1
    return 0, len(data) + 1


def number_in(message: Sequence[Field], number: int) -> int:
    """Return the last value of an integer field; 0 if the field is missing."""
    values = [value for key, wire_type, value in message if key == number and wire_type == VARINT]
    return int(values[-1]) if values else 0


def message_in(message: Sequence[Field], number: int) -> list[Field] | None:
    """Return a message within a message, empty if it is missing; None if its bytes are not a message."""
    parts = [value for key, wire_type, value in message if key == number and wire_type == BYTES]
    return fields(b"".join(part for part in parts if isinstance(part, bytes)))


def doubles_in(message: Sequence[Field], number: int) -> tuple[float, ...]:
    """Return the values of a repeated double, packed or not."""
    values = [packed for key, wire_type, packed in message if key == number and wire_type in (FIXED64, BYTES)]
    data = b"".join(packed for packed in values if isinstance(packed, bytes))
    return struct.unpack(f"<{len(data) // 8}d", data[: len(data) // 8 * 8])


def varint(value: int) -> bytes:
    """Encode an integer."""
    low, high = value & 0x7F, value >> 7
    return bytes([low | 0x80]) + varint(high) if high else bytes([low])


def integer(number: int, value: int) -> bytes:
    """Encode an integer field."""
    return varint(number << 3 | VARINT) + varint(value)


def nested(number: int, content: bytes) -> bytes:
    """Encode a message, or bytes, as a field."""
    return varint(number << 3 | BYTES) + varint(len(content)) + content


def doubles(number: int, values: Sequence[float]) -> bytes:
    """Encode a repeated double as proto2 does: each value as a field of its own."""
    key = varint(number << 3 | FIXED64)
    return b"".join(key + struct.pack("<d", value) for value in values)

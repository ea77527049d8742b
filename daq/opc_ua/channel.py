"""OPC UA over TCP without encryption: chunked messages for both sides (OPC 10000-6, 6.7, 7.1).

Messages are encoded by asyncua, and decoded here into objects of its types: its decoder trusts the lengths in a
message, so that an array of 2^31 nulls, a matrix of a million elements or texts of negative length, each in some twenty
bytes, exhaust the memory. Here each length is compared with the remaining bytes before anything is allocated.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, fields
from datetime import UTC, datetime
from enum import Enum
from functools import cache
from typing import Any, get_args

from asyncua import ua
from asyncua.ua.ua_binary import (
    Primitives,
    create_enum_deserializer,
    get_safe_type_hints,
    nodeid_from_binary,
    struct_to_binary,
)
from asyncua.ua.uatypes import type_from_optional, type_is_list, type_is_optional

from daq.protocol.framing import Sized

ELEMENTS = 65_536
"""Array elements per message: six times the references that fit into a message.

An element may take a single byte in the message and 200 bytes in memory (an empty DataValue).
"""
_IS_ARRAY, _HAS_DIMENSIONS, _TYPE = 0x80, 0x40, 0x3F
"""Bits in the first byte of a variant (OPC 10000-6, 5.2.2.16)."""
_BINARY_BODY, _UNKNOWN_SIZE = 1, -1
_UNREADABLE = (
    ua.UaError,
    struct.error,
    ValueError,
    TypeError,
    LookupError,
    AttributeError,
    ArithmeticError,
    RecursionError,
)
_EXTENSIONS = {
    ua.typeid_by_extension_objects[kind]: kind
    for kind in (
        ua.DataChangeNotification,
        ua.StatusChangeNotification,
        ua.EUInformation,
        ua.AnonymousIdentityToken,
    )
}
"""Structures decoded in fields of variable type. All others stay bytes."""


class Unreadable(Exception):
    """The data is not a valid OPC UA message of this conversation."""


class BoundedBuffer:
    """Bytes with a read position, also usable by asyncua. Every length is checked against the remaining bytes."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0
        self._elements = ELEMENTS

    def __len__(self) -> int:
        return len(self._data) - self._at

    def read(self, size: int) -> bytes:
        begin, self._at = self._at, self._at + size
        if not begin <= self._at <= len(self._data):
            raise ValueError(f"a length of {size}, but only {len(self._data) - begin} bytes remain")
        return self._data[begin : self._at]

    def elements(self) -> int:
        """Number of array elements; 0 for a null array. Every element except null takes at least one byte."""
        claimed: int = Primitives.Int32.unpack(self)
        if claimed > min(len(self), self._elements):
            raise ValueError(f"an array of {claimed} elements in {len(self)} bytes")
        count = max(0, claimed)
        self._elements -= count
        return count


Reader = Callable[[BoundedBuffer], Any]


def decoded(kind: type[Any], body: bytes) -> Any:
    return structure(kind, BoundedBuffer(body))


def structure(kind: Any, data: BoundedBuffer) -> Any:
    size = len(data)
    try:
        return _reader(kind)(data)
    except _UNREADABLE as error:
        raise Unreadable(f"{size} bytes cannot be decoded as {kind.__name__}: {error}") from None


def type_of(body: bytes) -> Any:
    try:
        return nodeid_from_binary(BoundedBuffer(body)).Identifier
    except _UNREADABLE as error:
        raise Unreadable(f"the message type cannot be decoded: {error}") from None


@cache
def _reader(kind: Any) -> Reader:
    if type_is_list(kind):
        return _array_reader(_reader(*get_args(kind)))
    if issubclass(kind, Enum):
        return create_enum_deserializer(kind)  # type: ignore[no-any-return]
    if hasattr(Primitives, kind.__name__):
        return getattr(Primitives, kind.__name__).unpack  # type: ignore[no-any-return]
    return _OTHERS.get(kind) or _structure_reader(kind)


def _array_reader(element: Reader) -> Reader:
    return lambda data: [element(data) for _ in range(data.elements())]


def _structure_reader(kind: type[Any]) -> Reader:
    """A reader of all fields in order; optional ones have a bit each in the field `Encoding`."""
    hints = get_safe_type_hints(kind, {"ua": ua})
    parts, next_bit = list[tuple[str, int, Reader]](), 1
    for field in fields(kind):
        hint, bit = hints[field.name], 0
        if type_is_optional(hint):
            hint, bit, next_bit = type_from_optional(hint), next_bit, next_bit << 1
        parts.append((field.name, bit, _reader(hint)))

    def read(data: BoundedBuffer) -> Any:
        values, present = dict[str, Any](), 0
        for name, bit, reader in parts:
            if name == "Encoding":
                present = reader(data)
            elif not bit or present & bit:
                values[name] = reader(data)
        return kind(**values)

    return read


def _variant(data: BoundedBuffer) -> Any:
    """Value with a type. A matrix is flattened, because none of the values used here is a matrix."""
    encoding = data.read(1)[0]
    kind = ua.VariantType(encoding & _TYPE)
    is_array = bool(encoding & _IS_ARRAY)
    reader = _reader(getattr(ua, kind.name))
    value = _array_reader(reader)(data) if is_array else reader(data)
    if encoding & _HAS_DIMENSIONS:
        _array_reader(Primitives.Int32.unpack)(data)
    return ua.Variant(value, kind, is_array=is_array)


def _extension_object(data: BoundedBuffer) -> Any:
    type_id, encoding = nodeid_from_binary(data), data.read(1)[0]
    kind = _EXTENSIONS.get(type_id)
    if not encoding:
        return ua.ExtensionObject(type_id)
    size = Primitives.Int32.unpack(data)
    if kind is None or encoding != _BINARY_BODY:
        return ua.ExtensionObject(type_id, Body=data.read(max(0, size)))
    before = len(data)
    structure = _reader(kind)(data)
    if size != _UNKNOWN_SIZE:
        data.read(size - (before - len(data)))  # fields of a later version
    return structure


_OTHERS: dict[Any, Reader] = {
    ua.NodeId: nodeid_from_binary,
    ua.ExpandedNodeId: nodeid_from_binary,
    ua.Variant: _variant,
    ua.ExtensionObject: _extension_object,
}


HELLO, ACKNOWLEDGE, ERROR, OPEN, MESSAGE, CLOSE = b"HEL", b"ACK", b"ERR", b"OPN", b"MSG", b"CLO"
_PLAIN = (HELLO, ACKNOWLEDGE, ERROR)
CHUNK = 65_536
"""Announced chunk size. Larger chunks are refused."""
LIMIT = 1 << 20
"""The references of about ten thousand nodes."""
_SMALLEST_CHUNK = 8192
"""Minimum chunk size that every side must accept (OPC 10000-6, 7.1.2.3)."""
CHUNKS = LIMIT // _SMALLEST_CHUNK
"""LIMIT, CHUNK and CHUNKS are announced to the peer and enforced."""
_INTERMEDIATE, _FINAL, _ABORT = b"C", b"F", b"A"
NO_SECURITY = "http://opcfoundation.org/UA/SecurityPolicy#None"
NO_STAMP = datetime(1601, 1, 1, tzinfo=UTC)
"""Null time. The time of a request or answer is only for logs and not known here."""
_HEADER = struct.Struct("<3scI")
_NUMBERS = struct.Struct("<II")


@dataclass(frozen=True, slots=True)
class Received:
    kind: bytes
    request: int
    body: bytes


def chunks() -> Sized:
    def size_of(header: bytes) -> int | None:
        kind, _, size = _HEADER.unpack(header)
        return size if kind in (*_PLAIN, OPEN, MESSAGE, CLOSE) and _HEADER.size <= size <= CHUNK else None

    return Sized(_HEADER.size, size_of)


class Channel:
    """A side of an unsecured secure channel. number, token: assigned by the server."""

    def __init__(self) -> None:
        self.number = self.token = 0
        self._sent = 0
        self._longest = CHUNK
        self._begun = 0
        self._parts: list[bytes] = []

    def agree(self, size: int) -> None:
        if size < _SMALLEST_CHUNK:
            raise Unreadable(f"chunks of at most {size} bytes; at least {_SMALLEST_CHUNK} are required")
        self._longest = min(CHUNK, size)

    def packed(self, kind: bytes, message: Any, request: int = 0) -> bytes:
        body: bytes = struct_to_binary(message)
        if kind in _PLAIN:
            return _HEADER.pack(kind, _FINAL, _HEADER.size + len(body)) + body
        security = struct_to_binary(ua.AsymmetricAlgorithmHeader()) if kind == OPEN else struct.pack("<I", self.token)
        head = struct.pack("<I", self.number) + security
        room = self._longest - _HEADER.size - len(head) - _NUMBERS.size
        parts = [body[begin : begin + room] for begin in range(0, len(body), room)]
        chunks = []
        for part, final in zip(parts, [_INTERMEDIATE] * (len(parts) - 1) + [_FINAL], strict=True):
            self._sent = self._sent % (2**32 - 1) + 1
            size = _HEADER.size + len(head) + _NUMBERS.size + len(part)
            chunks.append(_HEADER.pack(kind, final, size) + head + _NUMBERS.pack(self._sent, request) + part)
        return b"".join(chunks)

    def read(self, chunk: bytes) -> Received | None:
        """Message completed by a chunk; None if further chunks are needed."""
        kind, final, _ = _HEADER.unpack_from(chunk)
        if kind in _PLAIN:
            return Received(kind, 0, chunk[_HEADER.size :])
        if kind == OPEN:
            remainder = BoundedBuffer(chunk[_HEADER.size + 4 :])
            policy = structure(ua.AsymmetricAlgorithmHeader, remainder).SecurityPolicyURI
            if policy != NO_SECURITY:
                raise Unreadable(f"unsupported security policy {str(policy)[:100]!r}")
        else:
            remainder = BoundedBuffer(chunk[_HEADER.size + 8 :])
        request = structure(ua.SequenceHeader, remainder).RequestId
        part = remainder.read(len(remainder))
        if final == _ABORT:
            reply = decoded(ua.ErrorMessage, part)
            raise Unreadable(f"an incomplete message: {reply.Error.name} ({(reply.Reason or '')[:100]})")
        if final not in (_INTERMEDIATE, _FINAL):
            raise Unreadable(f"unsupported chunk type {final!r}")
        if self._parts and request != self._begun:
            raise Unreadable(f"a part of message {request} inside message {self._begun}")
        self._begun = request
        self._parts.append(part)
        if len(self._parts) > CHUNKS or sum(map(len, self._parts)) > LIMIT:
            raise Unreadable(f"a message of more than {LIMIT} bytes or {CHUNKS} chunks")
        if final == _INTERMEDIATE:
            return None
        whole, self._parts = b"".join(self._parts), []
        return Received(kind, request, whole)

"""OPC UA over TCP, without encryption: messages in chunks, as either side sends and reads them (OPC 10000-6, 6.7, 7.1).

A chunk begins with three letters, one more for whether others follow, and its size; then come the numbers of the
channel, of its token, of the chunk and of the request, and the message itself or a part of it. asyncua makes and reads
messages, and touches no network here.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from asyncua import ua
from asyncua.common.utils import Buffer
from asyncua.ua.ua_binary import nodeid_from_binary, struct_from_binary, struct_to_binary

from daq.protocol.framing import Sized

HELLO, ACKNOWLEDGE, ERROR, OPEN, MESSAGE, CLOSE = b"HEL", b"ACK", b"ERR", b"OPN", b"MSG", b"CLO"
_PLAIN = (HELLO, ACKNOWLEDGE, ERROR)
"""Messages in no channel."""
CHUNK = 65_536
"""Bytes of a chunk, the size that either side states; larger ones are refused."""
LIMIT = 1 << 20
"""Bytes of a message: the references of some ten thousand nodes."""
_INTERMEDIATE, _FINAL, _ABORT = b"C", b"F", b"A"
NO_SECURITY = "http://opcfoundation.org/UA/SecurityPolicy#None"
NO_STAMP = datetime(1601, 1, 1, tzinfo=UTC)
"""No time, as OPC UA writes it. The time of a request or an answer is for logs only, and is not known here."""
_HEADER = struct.Struct("<3scI")
_NUMBERS = struct.Struct("<II")
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
"""What asyncua's codec raises at bytes that are no such message."""


class Unreadable(Exception):
    """What came is no message of OPC UA, or not of this conversation."""


@dataclass(frozen=True, slots=True)
class Received:
    """A whole message: its three letters, the number of its request, and what it says."""

    kind: bytes
    request: int
    body: bytes


def chunks() -> Sized:
    """Return what cuts a stream into chunks."""
    return Sized(_HEADER.size, _chunk_size)


def _chunk_size(header: bytes) -> int | None:
    kind, _, size = _HEADER.unpack(header)
    known = kind in (*_PLAIN, OPEN, MESSAGE, CLOSE)
    return size if known and _HEADER.size <= size <= CHUNK else None


class Channel:
    """One side of a secure channel without security. number, token: as the server gave them."""

    def __init__(self) -> None:
        self.number = self.token = 0
        self._sent = 0
        self._parts = bytearray()

    def packed(self, kind: bytes, message: Any, request: int = 0) -> bytes:
        """Return the chunk with a message of asyncua's types. None of ours is longer than a chunk."""
        head = b""
        if kind not in _PLAIN:
            self._sent = self._sent % (2**32 - 1) + 1
            security = struct_to_binary(ua.AsymmetricAlgorithmHeader()) if kind == OPEN else _u32(self.token)
            head = _u32(self.number) + security + _NUMBERS.pack(self._sent, request)
        body: bytes = head + struct_to_binary(message)
        return _HEADER.pack(kind, _FINAL, _HEADER.size + len(body)) + body

    def read(self, chunk: bytes) -> Received | None:
        """Return the message that a chunk completes; None where more has to come. Raises Unreadable."""
        kind, more, _ = _HEADER.unpack_from(chunk)
        rest = Buffer(chunk[_HEADER.size :])
        if kind in _PLAIN:
            return Received(kind, 0, rest.read(len(rest)))
        try:
            rest.skip(4)
            if kind == OPEN:
                policy = struct_from_binary(ua.AsymmetricAlgorithmHeader, rest).SecurityPolicyURI
                if policy != NO_SECURITY:
                    raise Unreadable(f"a channel with the security policy {policy!r}")
            else:
                rest.skip(4)
            _, request = _NUMBERS.unpack(rest.read(_NUMBERS.size))
        except _UNREADABLE as error:
            raise Unreadable(f"the head of a message: {error}") from None
        return self._whole(kind, more, request, rest.read(len(rest)))

    def _whole(self, kind: bytes, more: bytes, request: int, body: bytes) -> Received | None:
        self._parts += body
        if len(self._parts) > LIMIT:
            raise Unreadable(f"a message of more than {LIMIT} bytes")
        if more == _INTERMEDIATE:
            return None
        whole, self._parts = bytes(self._parts), bytearray()
        return None if more == _ABORT else Received(kind, request, whole)


def _u32(number: int) -> bytes:
    return number.to_bytes(4, "little")


def decoded(kind: type[Any], body: bytes) -> Any:
    """Return a message as an object of asyncua's types. Raises Unreadable."""
    try:
        return struct_from_binary(kind, Buffer(body))
    except _UNREADABLE as error:
        raise Unreadable(f"{len(body)} bytes are no {kind.__name__}: {error}") from None


def type_of(body: bytes) -> Any:
    """Return the number of a message's type, as `TypeId.Identifier` of asyncua's types. Raises Unreadable."""
    try:
        return nodeid_from_binary(Buffer(body)).Identifier
    except _UNREADABLE as error:
        raise Unreadable(f"the type of a message: {error}") from None

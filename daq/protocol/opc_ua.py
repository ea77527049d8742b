"""OPC UA over TCP, without encryption: messages in chunks, as either side sends and reads them (OPC 10000-6, 6.7, 7.1).

A chunk begins with three letters, one more for whether others follow, and its size; then come the numbers of the
channel, of its token, of the chunk and of the request, and the message itself or a part of it. asyncua makes the
messages, `daq.protocol.opc_ua_codec` reads them.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from asyncua import ua
from asyncua.ua.ua_binary import struct_to_binary

from daq.protocol.framing import Sized
from daq.protocol.opc_ua_codec import Bounded, Unreadable, decoded, structure

HELLO, ACKNOWLEDGE, ERROR, OPEN, MESSAGE, CLOSE = b"HEL", b"ACK", b"ERR", b"OPN", b"MSG", b"CLO"
_PLAIN = (HELLO, ACKNOWLEDGE, ERROR)
"""Messages in no channel."""
CHUNK = 65_536
"""Bytes of a chunk, the size that either side states; larger ones are refused."""
LIMIT = 1 << 20
"""Bytes of a message: the references of some ten thousand nodes."""
_SMALLEST_CHUNK = 8192
"""Either side has to receive chunks of this size (OPC 10000-6, 7.1.2.3)."""
CHUNKS = LIMIT // _SMALLEST_CHUNK
"""Chunks of a message. LIMIT, CHUNK and CHUNKS are stated to the other side and hold whether or not it heeds them."""
_INTERMEDIATE, _FINAL, _ABORT = b"C", b"F", b"A"
NO_SECURITY = "http://opcfoundation.org/UA/SecurityPolicy#None"
NO_STAMP = datetime(1601, 1, 1, tzinfo=UTC)
"""No time, as OPC UA writes it. The time of a request or an answer is for logs only, and is not known here."""
_HEADER = struct.Struct("<3scI")
_NUMBERS = struct.Struct("<II")


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
    is_known = kind in (*_PLAIN, OPEN, MESSAGE, CLOSE)
    return size if is_known and _HEADER.size <= size <= CHUNK else None


class Channel:
    """One side of a secure channel without security. number, token: as the server gave them."""

    def __init__(self) -> None:
        self.number = self.token = 0
        self._sent = 0
        self._longest = CHUNK
        self._begun = 0
        self._parts: list[bytes] = []

    def agree(self, size: int) -> None:
        """Send no longer chunks than the other side receives. Raises Unreadable."""
        if size < _SMALLEST_CHUNK:
            raise Unreadable(f"chunks of at most {size} bytes, where {_SMALLEST_CHUNK} have to be received")
        self._longest = min(CHUNK, size)

    def packed(self, kind: bytes, message: Any, request: int = 0) -> bytes:
        """Return the chunks with a message of asyncua's types."""
        body: bytes = struct_to_binary(message)
        if kind in _PLAIN:
            return _HEADER.pack(kind, _FINAL, _HEADER.size + len(body)) + body
        security = struct_to_binary(ua.AsymmetricAlgorithmHeader()) if kind == OPEN else _u32(self.token)
        head = _u32(self.number) + security
        room = self._longest - _HEADER.size - len(head) - _NUMBERS.size
        parts = [body[begin : begin + room] for begin in range(0, len(body), room)]
        return b"".join(
            _HEADER.pack(kind, final, _HEADER.size + len(head) + _NUMBERS.size + len(part))
            + head
            + _NUMBERS.pack(self._next_number(), request)
            + part
            for part, final in zip(parts, [_INTERMEDIATE] * (len(parts) - 1) + [_FINAL], strict=True)
        )

    def _next_number(self) -> int:
        self._sent = self._sent % (2**32 - 1) + 1
        return self._sent

    def read(self, chunk: bytes) -> Received | None:
        """Return the message that a chunk completes; None where more has to come. Raises Unreadable."""
        kind, final, _ = _HEADER.unpack_from(chunk)
        if kind in _PLAIN:
            return Received(kind, 0, chunk[_HEADER.size :])
        if kind == OPEN:
            remainder = Bounded(chunk[_HEADER.size + 4 :])
            policy = structure(ua.AsymmetricAlgorithmHeader, remainder).SecurityPolicyURI
            if policy != NO_SECURITY:
                raise Unreadable(f"a channel with the security policy {str(policy)[:100]!r}")
        else:
            remainder = Bounded(chunk[_HEADER.size + 8 :])
        request = structure(ua.SequenceHeader, remainder).RequestId
        part = remainder.read(len(remainder))
        if final == _ABORT:
            reply = decoded(ua.ErrorMessage, part)
            raise Unreadable(f"a message is broken off: {reply.Error.name} ({(reply.Reason or '')[:100]})")
        if final not in (_INTERMEDIATE, _FINAL):
            raise Unreadable(f"a chunk of the kind {final!r}")
        if self._parts and request != self._begun:
            raise Unreadable(f"a part of message {request} within message {self._begun}")
        self._begun = request
        self._parts.append(part)
        if len(self._parts) > CHUNKS or sum(map(len, self._parts)) > LIMIT:
            raise Unreadable(f"a message of more than {LIMIT} bytes or {CHUNKS} chunks")
        if final == _INTERMEDIATE:
            return None
        whole, self._parts = b"".join(self._parts), []
        return Received(kind, request, whole)


def _u32(number: int) -> bytes:
    return number.to_bytes(4, "little")

"""Framers: split a byte stream into messages with the arrival times of the first and last byte.

A framer accepts pieces of any size. Both keep at most `LIMIT` bytes of an endless message; the excess is discarded and
reported as a single GARBLED fault.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from daq.protocol.conversation import NO_TIME, Fault, FaultKind, Sample

LIMIT = 1024
"""Twice the longest known message, an RTDE text of 516 bytes."""


@dataclass(frozen=True, slots=True)
class Message:
    data: bytes
    size: int
    first_byte_ns: int
    last_byte_ns: int

    def sample(
        self, values: Sequence[float], clock_s: float = math.nan, *, requested_ns: int = NO_TIME, status: int = 0
    ) -> Sample:
        stamps = (requested_ns, self.first_byte_ns, self.last_byte_ns)
        return Sample(tuple(values), *stamps, self.size, clock_s, status)

    def fault(self, kind: FaultKind, detail: str, count: int = 1) -> Fault:
        return Fault(kind, self.last_byte_ns, detail, count)


class Framer(Protocol):
    def feed(self, data: bytes, now_ns: int) -> Sequence[Message | Fault]:
        """Completed messages, and faults for data that forms no valid frame."""

    def clear(self) -> None:
        """Discard an unfinished message. The next byte starts a new one."""

    @property
    def pending(self) -> bool:
        """True if a message is unfinished."""


class Pieces:
    def __init__(self) -> None:
        self.data = bytearray()
        self._arrivals: deque[tuple[int, int]] = deque()

    def add(self, data: bytes, now_ns: int) -> None:
        if data:
            self.data += data
            self._arrivals.append((len(data), now_ns))

    def take(self, size: int, trailer: int = 0) -> Message:
        """Remove the first `size` bytes as a message. The last `trailer` bytes are not content."""
        content = bytes(self.data[: size - trailer])
        del self.data[:size]
        first_ns = last_ns = self._arrivals[0][1]
        remaining = size
        while remaining:
            length, last_ns = self._arrivals.popleft()
            if length > remaining:
                self._arrivals.appendleft((length - remaining, last_ns))
            remaining -= min(length, remaining)
        return Message(content, size, first_ns, last_ns)

    def clear(self) -> None:
        self.data.clear()
        self._arrivals.clear()


class DelimitedLines:
    """Messages that end in a delimiter. `joined_midway`: discard the bytes before the first one.

    A line feed after a carriage return as the delimiter is skipped, because some gauges can send either.
    """

    echo = b""
    """Sent data that some instruments and adapters return before the answer; it is skipped."""

    def __init__(self, delimiter: bytes, *, joined_midway: bool = False) -> None:
        self._delimiter = delimiter
        self._pieces = Pieces()
        self._skipping = joined_midway

    @property
    def pending(self) -> bool:
        return self._skipping or bool(self._pieces.data)

    def clear(self) -> None:
        self._pieces.clear()
        self._skipping = False

    def feed(self, data: bytes, now_ns: int) -> Sequence[Message | Fault]:
        pieces, ending = self._pieces, len(self._delimiter)
        pieces.add(data, now_ns)
        messages: list[Message | Fault] = []
        if self.echo and pieces.data.startswith(self.echo):
            pieces.take(len(self.echo))
        while True:
            while self._delimiter == b"\r" and pieces.data.startswith(b"\n"):
                pieces.take(1)
            content = pieces.data.find(self._delimiter)
            if content < 0:
                break
            message = pieces.take(content + ending, trailer=ending)
            if not self._skipping:
                messages.append(self._endless(now_ns) if message.size > LIMIT else message)
            self._skipping = False
        if len(pieces.data) >= LIMIT:
            if not self._skipping:
                messages.append(self._endless(now_ns))
            self._skipping = True
        if self._skipping and (surplus := len(pieces.data) - ending + 1) > 0:
            pieces.take(surplus)  # the remainder may be the start of a delimiter
        return messages

    def _endless(self, now_ns: int) -> Fault:
        detail = f"over {LIMIT} bytes without {self._delimiter!r}; check the line settings and the interface"
        return Fault(FaultKind.GARBLED, now_ns, detail)


class Sized:
    """Messages with a length that follows from the first `header` bytes.

    `length` returns None for bytes that cannot start a message. Such a stream cannot be resynchronised from its
    content: all further data is discarded until `clear`.
    """

    def __init__(self, header: int, length: Callable[[bytes], int | None]) -> None:
        self._header = header
        self._length = length
        self._pieces = Pieces()
        self._lost = False

    @property
    def pending(self) -> bool:
        return self._lost or bool(self._pieces.data)

    def clear(self) -> None:
        self._pieces.clear()
        self._lost = False

    def feed(self, data: bytes, now_ns: int) -> Sequence[Message | Fault]:
        if self._lost:
            return []
        if not self._pieces.data and len(data) >= self._header and self._length(data[: self._header]) == len(data):
            # the usual case: a complete answer that need not be split
            return [Message(data, len(data), now_ns, now_ns)]
        self._pieces.add(data, now_ns)
        messages: list[Message | Fault] = []
        while size := self._next_size(self._pieces.data):
            messages.append(self._pieces.take(size))
        if size is None:
            head = bytes(self._pieces.data[: self._header])
            self._pieces.clear()
            self._lost = True
            messages.append(Fault(FaultKind.GARBLED, now_ns, f"a message cannot begin with {head.hex(' ')}"))
        return messages

    def _next_size(self, pending: bytearray) -> int | None:
        """Size of the complete message. 0 if more data is needed, None if the bytes cannot start a message."""
        if len(pending) < self._header:
            return 0
        size = self._length(bytes(pending[: self._header]))
        return size if size is None or size <= len(pending) else 0

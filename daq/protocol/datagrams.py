"""Datagrams in place of a stream: what is read at once is one message, and nothing ever continues in the next.

`DatagramLines` is for texts: a datagram holds whole lines, the last of which needs no end.

A framer like those of `daq.protocol.framing`, so that a conversation need not know what carried its bytes. The
other way it is as plain: what a step sends is one datagram.
"""

from __future__ import annotations

from collections.abc import Sequence

from daq.protocol.conversation import Fault, FaultKind
from daq.protocol.framing import Message

LIMIT = 4096
"""Several times the longest message known here, an RSI text with every element that it can carry."""


class Datagrams:
    """Treats each piece as one message; one longer than `limit` bytes is a GARBLED fault."""

    pending = False

    def __init__(self, limit: int = LIMIT) -> None:
        self._limit = limit

    def clear(self) -> None:
        """Do nothing, since nothing is ever held."""

    def feed(self, data: bytes, now_ns: int) -> Sequence[Message | Fault]:
        if len(data) > self._limit:
            return [Fault(FaultKind.GARBLED, now_ns, f"a datagram of {len(data)} bytes, over {self._limit}; left out")]
        return [Message(data, len(data), now_ns, now_ns)]


class DatagramLines(Datagrams):
    """Treats each line of a datagram as one message; the datagrams as `Datagrams` does."""

    def feed(self, data: bytes, now_ns: int) -> Sequence[Message | Fault]:
        found: list[Message | Fault] = []
        for datagram in super().feed(data, now_ns):
            if isinstance(datagram, Fault):
                found.append(datagram)
            else:
                found += [Message(line, len(line), now_ns, now_ns) for line in datagram.data.splitlines()]
        return found

"""Cutting a serial stream of Modbus RTU into frames, on either side.

RTU frames end with silence, which a pure protocol cannot see and adapters do not keep. So a frame is known by its
length, which its first bytes give, and by its checksum. A host hears more than the answers to it: its own request where
the adapter echoes, and those of another host on the line.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from pymodbus.framer import FramerRTU

from daq.protocol.framing import Message, Sized
from rigs.schema.links import Line

REQUEST = 8
"""Bytes of a request to read registers; no answer to one has as many."""
_HEAD = 3
_REQUESTS = range(1, 7)
"""Functions whose requests have so many bytes (Modbus application protocol V1.1b3, 6.1 to 6.6)."""
_MOST_BYTES = 250
"""The most that the registers in an answer take: there are 125 at most (the same, 6.3)."""
_QUICK_BAUD, _QUICK_NS, _CHARACTERS = 19_200, 1_750_000, 3.5


def silent_interval_ns(line: Line) -> int:
    """Return the silence that must go before a frame, by which units on one line know where it begins.

    3.5 characters, above 19 200 baud 1.75 ms (Modbus over serial line V1.02, 2.5.1.1).
    """
    return _QUICK_NS if line.baud > _QUICK_BAUD else round(_CHARACTERS * line.character_ns)


def intact(frame: bytes) -> bool:
    """Return whether the checksum at the end of a frame is right."""
    return FramerRTU.check_CRC(frame[:-2], int.from_bytes(frame[-2:], "big"))


class RtuRequests:
    """The requests in a serial stream: any eight bytes with the right checksum; others pass by."""

    def __init__(self) -> None:
        self._data = bytearray()

    @property
    def pending(self) -> bool:
        return bool(self._data)

    def clear(self) -> None:
        self._data.clear()

    def feed(self, data: bytes, now_ns: int) -> Sequence[Message]:
        self._data += data
        found, start = list[Message](), 0
        while len(self._data) - start >= REQUEST:
            frame = bytes(self._data[start : start + REQUEST])
            good = intact(frame)
            if good:
                found.append(Message(frame, REQUEST, now_ns, now_ns))
            start += REQUEST if good else 1
        del self._data[:start]
        return found


class RtuReplies(Sized):
    """The answers in a serial stream, and requests among them.

    counts: how many registers an answer may have, by unit and function; any number of a unit that is not listed.
    """

    def __init__(self, counts: Mapping[tuple[int, int], Collection[int]]) -> None:
        super().__init__(_HEAD, self._answer_size)
        self.asked = b""
        """The request on the line, which may be echoed."""
        self._counts = counts

    def _next_size(self, pending: bytearray) -> int | None:
        data = bytes(pending)
        if len(data) < _HEAD:
            return 0
        answer = self._answer_size(data)
        if 0 < answer <= len(data) and intact(data[:answer]):
            return answer
        if self.asked and self.asked.startswith(data[:REQUEST]):
            return REQUEST if len(data) >= REQUEST else 0
        if len(data) < (answer or (REQUEST if data[1] in _REQUESTS else 0)):
            return 0  # an answer of nine bytes whose last is 0 is intact without it, too
        if len(data) >= REQUEST and intact(data[:REQUEST]):
            return REQUEST
        return answer or None

    def _answer_size(self, head: bytes) -> int:
        """The size of an answer that begins so, 0 where none does."""
        unit, function, size = head[:_HEAD]
        counts = self._counts.get((unit, function & 0x7F))
        if function & 0x7F not in (3, 4):
            return 0
        if function & 0x80:
            return 5
        good = 2 <= size <= _MOST_BYTES and size % 2 == 0 if counts is None else size / 2 in counts
        return 5 + size if good else 0

"""Modbus register reads on the wire, RTU, ASCII and TCP: pymodbus encodes and decodes, the framing is ours.

pymodbus' own framers, fed a stream, swallow all they hold on a checksum error, hunt through junk for
something that looks like a frame, and raise. So they are only ever handed exact frames, whose length is
known beforehand: TCP gives its length, ASCII ends in CR LF, and RTU is cut by `RtuReplies`.

Modbus itself knows registers of 16 bits alone, the higher byte first. How a longer number, of up to 64 bits, lies in
them is up to the instrument, and both orders are met: `word_order` is that of the registers of a value, `byte_order`
that of the bytes of each register.

Late answers carry no number, so after a time-out something of another length is requested. An instrument answers in
order. So once a probe has its answer, whatever was asked before is answered or lost, and the next request's answer is
its own, however late the instrument is. Until then an answer of a reading's length is late. Probes in a row ask for
different lengths, which come round again after `LENGTHS` of them.

Some instrument may answer nothing but its usual request. Until one probe has been answered, only `TRIES` are made,
and one more for each reading that was answered in time. A request made after that is `doubtful`, since its answer may
belong to an earlier one.

RTU frames end with silence, which a pure protocol cannot see and adapters do not keep. So on either side a frame is
known by its length, which its first bytes give, and by its checksum. A host hears more than the answers to it: its own
request where the adapter echoes, and those of another host on the line.
"""

from __future__ import annotations

import logging
import math
import re
import struct
from collections.abc import Collection, Mapping, Sequence
from typing import Literal, Protocol

from pymodbus.framer import FramerAscii, FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU, ModbusPDU
from pymodbus.pdu.register_message import ReadHoldingRegistersRequest, ReadInputRegistersRequest

from daq.protocol.framing import Framer, Lines, Message, Sized
from rigs.schema.links import Line, tcp_address
from rigs.schema.modbus import Framing, Number, Order, Register

_CODES: dict[Number, str] = {
    "int16": "h",
    "uint16": "H",
    "float16": "e",
    "int32": "i",
    "uint32": "I",
    "float32": "f",
    "int64": "q",
    "uint64": "Q",
    "float64": "d",
}
_NUMBER = {name: struct.Struct(f">{code}") for name, code in _CODES.items()}
_WORDS = {
    (order, count): struct.Struct(f"{mark}{count}H")
    for order, mark in (("big", ">"), ("little", "<"))
    for count in (1, 2, 4)
}
_LARGEST: dict[Number, float] = {"float16": 65504.0, "float32": (2 - 2**-23) * 2.0**127, "float64": math.inf}
"""The largest number of each floating type (IEEE 754)."""


class Layout(Protocol):
    """Where a block begins, and how the numbers lie in it."""

    @property
    def address(self) -> int:
        """The first register."""

    @property
    def word_order(self) -> Order:
        """The order of the registers of a value."""

    @property
    def byte_order(self) -> Order:
        """The order of the bytes of a register."""


def unpack(registers: Sequence[int], register: Register, layout: Layout) -> float:
    """Return one value of the block."""
    number = _NUMBER[register.type]
    start = register.address - layout.address
    words = registers[start : start + number.size // 2]
    in_order = words if layout.word_order == "big" else words[::-1]
    value: float = number.unpack(_WORDS[layout.byte_order, len(words)].pack(*in_order))[0]
    return value


def pack(registers: list[int], register: Register, layout: Layout, value: float) -> None:
    """Put one value into the block."""
    start = register.address - layout.address
    data = _NUMBER[register.type].pack(value if register.type in _LARGEST else round(value))
    words = _WORDS[layout.byte_order, register.count].unpack(data)
    registers[start : start + register.count] = words if layout.word_order == "big" else words[::-1]


def fits(raw: float, register: Register) -> bool:
    """Return whether the register's type can hold the value."""
    if not math.isfinite(raw):
        return False
    if register.type in _LARGEST:
        return abs(raw) <= _LARGEST[register.type]
    bits = 16 * register.count
    lowest = -(1 << bits - 1) if register.type.startswith("int") else 0
    return lowest <= round(raw) < lowest + (1 << bits)


LENGTHS = 8
TRIES = 3


class Resync:
    """Chooses the length of an instrument's next answer, so that a late answer can be recognised by its length."""

    def __init__(self) -> None:
        self.usual: set[int] = set()
        """The lengths of its readings."""
        self.owed = False
        """Whether a request is unanswered."""
        self.probing = False
        """Whether the request on the line is a probe."""
        self.doubtful = False
        """Whether the request on the line is a reading's while an answer of that length is owed."""
        self._proven = False
        self._probes = 0
        self._tries = TRIES

    @property
    def counts(self) -> list[int]:
        """The lengths of probes, which no reading has."""
        return [count for count in range(1, LENGTHS + len(self.usual) + 1) if count not in self.usual][:LENGTHS]

    def add(self, count: int) -> None:
        """Note the length of one of its readings."""
        self.usual.add(count)

    def ask(self, count: int) -> int:
        """Return the length to request now: that of the reading, or a probe's while an answer is outstanding."""
        self.probing = self.owed and (self._proven or self._tries > 0)
        self.doubtful = self.owed and not self.probing
        self.owed = True
        if not self.probing:
            return count
        self._tries -= 1
        self._probes += 1
        return self.counts[(self._probes - 1) % LENGTHS]

    def answered(self) -> None:
        """Note that the expected answer has come."""
        self.owed = False
        self._proven |= self.probing
        self._tries = max(self._tries, 1)


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
        requests, start = list[Message](), 0
        while len(self._data) - start >= REQUEST:
            frame = bytes(self._data[start : start + REQUEST])
            good = intact(frame)
            if good:
                requests.append(Message(frame, REQUEST, now_ns, now_ns))
            start += REQUEST if good else 1
        del self._data[:start]
        return requests


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


_REQUEST = {3: ReadHoldingRegistersRequest, 4: ReadInputRegistersRequest}
_ASCII_END = b"\r\n"
_ASCII_REQUEST = 15
"""Characters of a request to read registers, without its end; no answer to one has as many."""
_ASCII = re.compile(rb":(?:[0-9A-Fa-f]{2}){3,}")
logging.getLogger("pymodbus.logging").setLevel(logging.CRITICAL + 1)
"""It logs each frame that it cannot decode; here that is a fault, reported at a limited rate."""


class Block(Layout, Protocol):
    """What a rig file says about the registers to be read."""

    @property
    def port(self) -> str:
        """The port: TCP if it is an address, else a serial device."""

    @property
    def framing(self) -> Framing:
        """The framing on a serial line."""

    @property
    def unit(self) -> int:
        """The number of the instrument on its line or behind its gateway."""

    @property
    def function(self) -> Literal[3, 4]:
        """The function code: 3 reads holding registers, 4 input registers."""

    @property
    def count(self) -> int:
        """The number of registers."""


class Wire:
    """The frames of one side of a line or a connection, and the blocks that are read over it."""

    def __init__(self, port: str, framing: Framing, *, serving: bool) -> None:
        self.numbered = tcp_address(port) is not None
        """Whether requests and replies carry a transaction id."""
        self.frames: Framer
        self._number = 0
        self._counts: dict[tuple[int, int], set[int]] = {}
        self._resyncs: dict[int, Resync] = {}
        codec = DecodePDU(is_server=serving)
        self._framer: FramerSocket | FramerAscii | FramerRTU
        self._ending = b""
        self._replies: RtuReplies | None = None
        if self.numbered:
            self._framer, self.frames = FramerSocket(codec), Sized(7, _tcp_length)
        elif framing == "ascii":
            self._framer, self.frames, self._ending = FramerAscii(codec), Lines(_ASCII_END), _ASCII_END
        elif serving:
            self._framer, self.frames = FramerRTU(codec), RtuRequests()
        else:
            self._framer, self.frames = FramerRTU(codec), RtuReplies(self._counts)
            self._replies = self.frames

    def resync_of(self, block: Block) -> Resync:
        """Return which answer is expected of this block's unit on a serial line; the block is read from now on."""
        resync = self._resyncs.setdefault(block.unit, Resync())
        resync.add(block.count)
        self._counts.setdefault((block.unit, block.function), set()).update(resync.usual, resync.counts)
        return resync

    def owes(self, unit: int) -> bool:
        """Return whether a unit that is read over this line has left a request unanswered."""
        return unit in self._resyncs and self._resyncs[unit].owed

    def request(self, unit: int, function: int, address: int, count: int) -> bytes:
        """Return the request to read so many registers, without the transaction id that `numbering` gives it."""
        return self.encode(_REQUEST[function](dev_id=unit, address=address, count=count))

    def encode(self, pdu: ModbusPDU) -> bytes:
        """Return the frame of a PDU."""
        return self._framer.buildFrame(pdu)

    def numbering(self, request: bytes) -> bytes:
        """Return the request with the next transaction id, where requests carry one; it is then on the line."""
        if self._replies:
            self._replies.asked = request
        if not self.numbered:
            return request
        self._number = self._number % 0xFFFF + 1
        return self._number.to_bytes(2, "big") + request[2:]

    def open(self, frame: bytes) -> tuple[int, int, bytes]:
        """Return unit, transaction id and content of a frame; the content is empty if the frame is damaged."""
        if self._ending and not _ASCII.fullmatch(frame):
            return 0, 0, b""
        _, unit, number, content = self._framer.decode(frame + self._ending)
        return unit, number, content

    def asks(self, frame: bytes) -> int | None:
        """Return the unit that a frame on a serial line asks; None for an answer."""
        if self.numbered or len(frame) != (_ASCII_REQUEST if self._ending else REQUEST):
            return None
        unit, _, content = self.open(frame) if self._ending else (frame[0], 0, frame)
        return unit if content else None

    def is_sent(self, frame: bytes, request: bytes) -> bool:
        """Return whether a frame is this request, as an adapter with an echo brings it back."""
        return frame + self._ending == request

    def decode(self, content: bytes) -> ModbusPDU | None:
        """Decode the content of a request."""
        return self._framer.decoder.decode(content)


def exception_of(content: bytes) -> int | None:
    """Return the code of an exception; None for any other content."""
    return content[1] if len(content) == 2 and content[0] & 0x80 else None


def registers_of(content: bytes) -> tuple[int, ...] | None:
    """Return the registers of an answer to a read; None for any other content, also of another length than it says."""
    size = len(content) - 2
    if size < 0 or size % 2 or content[0] & 0x80 or content[1] != size:
        return None
    return struct.unpack(f">{size // 2}H", content[2:])


def _tcp_length(head: bytes) -> int | None:
    protocol, length = int.from_bytes(head[2:4], "big"), int.from_bytes(head[4:6], "big")
    return 6 + length if protocol == 0 and 3 <= length <= 254 else None

"""Modbus register reads: RTU, ASCII and TCP. pymodbus encodes and decodes; the framing is implemented here.

The framers of pymodbus discard everything on a checksum error, search junk for possible frames, and raise exceptions.
Here they only receive exact frames of known length. A host also receives the echo of its request from some adapters,
and requests of a second host.
"""

from __future__ import annotations

import logging
import math
import re
import struct
from collections.abc import Collection, Mapping, Sequence

from pymodbus.framer import FramerAscii, FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU, ModbusPDU
from pymodbus.pdu.register_message import ReadHoldingRegistersRequest, ReadInputRegistersRequest

from daq.protocol.framing import DelimitedLines, Framer, Message, Sized
from rigs.schema.feedback import ModbusJoints
from rigs.schema.links import Line, tcp_address
from rigs.schema.modbus import Framing, ModbusMap, Number, Register, RegisterBlock

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
"""Largest finite value of each floating type (IEEE 754)."""


def unpack(registers: Sequence[int], register: Register, layout: RegisterBlock) -> float:
    number = _NUMBER[register.type]
    start = register.address - layout.address
    words = registers[start : start + number.size // 2]
    in_order = words if layout.word_order == "big" else words[::-1]
    value: float = number.unpack(_WORDS[layout.byte_order, len(words)].pack(*in_order))[0]
    return value


def pack(registers: list[int], register: Register, layout: RegisterBlock, value: float) -> None:
    start = register.address - layout.address
    data = _NUMBER[register.type].pack(value if register.type in _LARGEST else round(value))
    words = _WORDS[layout.byte_order, register.count].unpack(data)
    registers[start : start + register.count] = words if layout.word_order == "big" else words[::-1]


def fits(raw: float, register: Register) -> bool:
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
    """Selects the length of the next request so that late answers, which have no number, are recognised by it.

    After a time-out a request of a different length follows, as a probe. An instrument answers in order: when a probe
    is answered, all earlier requests are answered or lost. Consecutive probes have different lengths, which repeat
    after `LENGTHS` probes. Some instruments may answer only their usual request, so until a probe has been answered
    only `TRIES` probes are made, plus one for each reading answered in time.
    """

    def __init__(self) -> None:
        self.usual: set[int] = set()
        self.owed = False
        self.probing = False
        self.doubtful = False
        """True if the current request is a reading, although an answer of the same length is outstanding."""
        self._proven = False
        self._probes = 0
        self._tries = TRIES

    @property
    def counts(self) -> list[int]:
        return [count for count in range(1, LENGTHS + len(self.usual) + 1) if count not in self.usual][:LENGTHS]

    def ask(self, count: int) -> int:
        """Length of the next request: the given length, or of a probe while an answer is outstanding."""
        self.probing = self.owed and (self._proven or self._tries > 0)
        self.doubtful = self.owed and not self.probing
        self.owed = True
        if not self.probing:
            return count
        self._tries -= 1
        self._probes += 1
        return self.counts[(self._probes - 1) % LENGTHS]

    def answered(self) -> None:
        self.owed = False
        self._proven |= self.probing
        self._tries = max(self._tries, 1)


REQUEST = 8
"""Bytes of a read request. It differs from the length of every answer."""
_HEAD = 3
_REQUESTS = range(1, 7)
"""Functions with requests of this length (Modbus application protocol V1.1b3, 6.1 to 6.6)."""
_MOST_BYTES = 250
"""Maximum number of register bytes in an answer, 125 registers (V1.1b3, 6.3)."""
_QUICK_BAUD, _QUICK_NS, _CHARACTERS = 19_200, 1_750_000, 3.5


def silent_interval_ns(line: Line) -> int:
    """Silence before a frame by which the units recognise the start.

    3.5 characters, or 1.75 ms above 19 200 baud (Modbus over serial line V1.02, 2.5.1.1).
    """
    return _QUICK_NS if line.baud > _QUICK_BAUD else round(_CHARACTERS * line.character_ns)


def intact(frame: bytes) -> bool:
    return FramerRTU.check_CRC(frame[:-2], int.from_bytes(frame[-2:], "big"))


class RtuRequests:
    """Requests in a serial stream: any eight bytes with a correct checksum. Other data is skipped."""

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
    """Answers in a serial stream, and requests among them.

    counts: possible register counts of an answer, by unit and function; others accept any count.
    """

    def __init__(self, counts: Mapping[tuple[int, int], Collection[int]]) -> None:
        super().__init__(_HEAD, self._answer_size)
        self.asked = b""
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
            return 0  # if an answer of nine bytes ends in 0, its first eight bytes also have a correct checksum
        if len(data) >= REQUEST and intact(data[:REQUEST]):
            return REQUEST
        return answer or None

    def _answer_size(self, head: bytes) -> int:
        """0 if invalid."""
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
"""Characters of a read request, excluding the line end. It differs from the length of every answer."""
_ASCII = re.compile(rb":(?:[0-9A-Fa-f]{2}){3,}")
logging.getLogger("pymodbus.logging").setLevel(logging.CRITICAL + 1)
"""pymodbus logs each undecodable frame. Here such a frame is a fault with a limited rate."""


ReadBlock = ModbusMap | ModbusJoints


class Wire:
    """Frames of one side of a line or connection, and the blocks read over it."""

    def __init__(self, port: str, framing: Framing, *, serving: bool) -> None:
        self.numbered = tcp_address(port) is not None
        """True if frames have a transaction id."""
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
            self._framer, self.frames, self._ending = FramerAscii(codec), DelimitedLines(_ASCII_END), _ASCII_END
        elif serving:
            self._framer, self.frames = FramerRTU(codec), RtuRequests()
        else:
            self._framer, self.frames = FramerRTU(codec), RtuReplies(self._counts)
            self._replies = self.frames

    def resync_of(self, block: ReadBlock) -> Resync:
        """Register a block. Returns the resynchronisation of its unit on a serial line."""
        resync = self._resyncs.setdefault(block.unit, Resync())
        resync.usual.add(block.count)
        self._counts.setdefault((block.unit, block.function), set()).update(resync.usual, resync.counts)
        return resync

    def owes(self, unit: int) -> bool:
        return unit in self._resyncs and self._resyncs[unit].owed

    def request(self, unit: int, function: int, address: int, count: int) -> bytes:
        return self.encode(_REQUEST[function](dev_id=unit, address=address, count=count))

    def encode(self, pdu: ModbusPDU) -> bytes:
        return self._framer.buildFrame(pdu)

    def numbering(self, request: bytes) -> bytes:
        """Add the next transaction id to the request, if any. It becomes the current request."""
        if self._replies:
            self._replies.asked = request
        if not self.numbered:
            return request
        self._number = self._number % 0xFFFF + 1
        return self._number.to_bytes(2, "big") + request[2:]

    def open(self, frame: bytes) -> tuple[int, int, bytes]:
        """Unit, transaction id and content of a frame. The content of a damaged frame is empty."""
        if self._ending and not _ASCII.fullmatch(frame):
            return 0, 0, b""
        _, unit, number, content = self._framer.decode(frame + self._ending)
        return unit, number, content

    def asks(self, frame: bytes) -> int | None:
        """Unit addressed by a request on a serial line; None for an answer."""
        if self.numbered or len(frame) != (_ASCII_REQUEST if self._ending else REQUEST):
            return None
        unit, _, content = self.open(frame) if self._ending else (frame[0], 0, frame)
        return unit if content else None

    def is_echo(self, frame: bytes, request: bytes) -> bool:
        """True if an adapter has returned the request."""
        return frame + self._ending == request

    def decode(self, content: bytes) -> ModbusPDU | None:
        return self._framer.decoder.decode(content)


def exception_of(content: bytes) -> int | None:
    return content[1] if len(content) == 2 and content[0] & 0x80 else None


def registers_of(content: bytes) -> tuple[int, ...] | None:
    size = len(content) - 2
    if size < 0 or size % 2 or content[0] & 0x80 or content[1] != size:
        return None
    return struct.unpack(f">{size // 2}H", content[2:])


def _tcp_length(head: bytes) -> int | None:
    protocol, length = int.from_bytes(head[2:4], "big"), int.from_bytes(head[4:6], "big")
    return 6 + length if protocol == 0 and 3 <= length <= 254 else None

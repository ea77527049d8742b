"""Modbus register reads on the wire, RTU, ASCII and TCP: pymodbus encodes and decodes, the framing is ours.

pymodbus' own framers, fed a stream, swallow all they hold on a checksum error, hunt through junk for
something that looks like a frame, and raise. So they are only ever handed exact frames, whose length is
known beforehand: TCP gives its length, ASCII ends in CR LF, and RTU is cut by `daq.protocol.rtu`.
"""

from __future__ import annotations

import logging
import re
import struct
from typing import Literal, Protocol

from pymodbus.framer import FramerAscii, FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU, ModbusPDU
from pymodbus.pdu.register_message import ReadHoldingRegistersRequest, ReadInputRegistersRequest

from daq.protocol.framing import Framer, Lines, Sized
from daq.protocol.register_values import Layout
from daq.protocol.resync import Resync
from daq.protocol.rtu import REQUEST, RtuReplies, RtuRequests
from rigs.schema.links import tcp_address
from rigs.schema.modbus import Framing

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

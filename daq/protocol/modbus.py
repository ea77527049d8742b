"""Modbus register reads on the wire, RTU, ASCII and TCP: pymodbus encodes and decodes, the framing is ours.

pymodbus' own framers, fed a stream, swallow all they hold on a checksum error, hunt through junk for
something that looks like a frame, and raise. So they are only ever handed exact frames, whose length is
known beforehand: an RTU reply has 5 + 2·count bytes, or 5 for an exception; TCP gives its length; ASCII ends in
CR LF. RTU frames end with silence, which a pure protocol cannot see and adapters do not keep.
"""

from __future__ import annotations

import logging
import re
import struct
from collections.abc import Sequence
from typing import Literal, Protocol

from pymodbus.framer import FramerAscii, FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU, ModbusPDU
from pymodbus.pdu.register_message import ReadHoldingRegistersRequest, ReadInputRegistersRequest

from daq.protocol.framing import Framer, Lines, Message, Sized
from daq.protocol.resync import Resync
from rigs.schema.links import tcp_address
from rigs.schema.modbus import Order

_REQUEST = {3: ReadHoldingRegistersRequest, 4: ReadInputRegistersRequest}
_RTU_REQUEST = 8
_ASCII_END = b"\r\n"
_ASCII = re.compile(rb":(?:[0-9A-Fa-f]{2}){3,}")
logging.getLogger("pymodbus.logging").setLevel(logging.CRITICAL + 1)
"""It logs each frame that it cannot decode; here that is a fault, reported at a limited rate."""


class Block(Protocol):
    """What a rig file says about the registers to be read."""

    @property
    def port(self) -> str:
        """The port: TCP if it is an address, else a serial device."""

    @property
    def framing(self) -> Literal["rtu", "ascii"]:
        """The framing on a serial line."""

    @property
    def unit(self) -> int:
        """The number of the instrument on its line or behind its gateway."""

    @property
    def function(self) -> Literal[3, 4]:
        """The function code: 3 reads holding registers, 4 input registers."""

    @property
    def address(self) -> int:
        """The first register."""

    @property
    def count(self) -> int:
        """The number of registers."""

    @property
    def word_order(self) -> Order:
        """The order of the registers of a value."""

    @property
    def byte_order(self) -> Order:
        """The order of the bytes of a register."""


class Wire:
    """The frames of one side, RTU or TCP as the port requires."""

    def __init__(self, block: Block, *, serving: bool, resync: Resync | None = None) -> None:
        self.numbered = tcp_address(block.port) is not None
        """Whether requests and replies carry a transaction id."""
        self.frames: Framer
        self.resync = resync or Resync(block.count)
        """Which answer is expected on a serial line."""
        self._block = block
        self._requests: dict[int, bytes] = {}
        codec = DecodePDU(is_server=serving)
        self._framer: FramerSocket | FramerAscii | FramerRTU
        self._ending = b""
        if self.numbered:
            self._framer, self.frames = FramerSocket(codec), Sized(7, _tcp_length)
        elif block.framing == "ascii":
            self._framer, self.frames, self._ending = FramerAscii(codec), Lines(_ASCII_END), _ASCII_END
        else:
            self._framer, self.frames = FramerRTU(codec), RtuRequests() if serving else Sized(3, self._rtu_reply_length)

    def encode(self, pdu: ModbusPDU) -> bytes:
        """Return the frame of a PDU."""
        return self._framer.buildFrame(pdu)

    def request(self, number: int) -> bytes:
        """Return the request for the whole block; on a serial line it may be a probe, a read of another length."""
        if self.numbered:
            return number.to_bytes(2, "big") + self._request(self._block.count)[2:]
        return self._request(self.resync.ask())

    def _request(self, count: int) -> bytes:
        """The request for so many registers, which differs from the one before by its transaction id only."""
        if count not in self._requests:
            b = self._block
            self._requests[count] = self.encode(_REQUEST[b.function](dev_id=b.unit, address=b.address, count=count))
        return self._requests[count]

    def open(self, frame: bytes) -> tuple[int, int, bytes]:
        """Return unit, transaction id and content of a frame; the content is empty if the frame is damaged."""
        if self._ending and not _ASCII.fullmatch(frame):
            return 0, 0, b""
        _, unit, number, content = self._framer.decode(frame + self._ending)
        return unit, number, content

    def decode(self, content: bytes) -> ModbusPDU | None:
        """Decode the content of a request."""
        return self._framer.decoder.decode(content)

    def _rtu_reply_length(self, head: bytes) -> int | None:
        unit, function, size = head
        if unit != self._block.unit or function & 0x7F != self._block.function:
            return None
        if function & 0x80:
            return 5
        return 5 + size if size / 2 in (self._block.count, *self.resync.counts) else None


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
        while len(self._data) - start >= _RTU_REQUEST:
            frame = bytes(self._data[start : start + _RTU_REQUEST])
            good = FramerRTU.check_CRC(frame[:-2], int.from_bytes(frame[-2:], "big"))
            if good:
                found.append(Message(frame, _RTU_REQUEST, now_ns, now_ns))
            start += _RTU_REQUEST if good else 1
        del self._data[:start]
        return found

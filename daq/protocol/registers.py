"""Reading and serving of a block of Modbus registers, for gauges and controllers.

The block is read in a single request: a value of several registers must not be split (Baumer OM20/OM30 manual p. 22,
confirmed), and all values must be from the same instant.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from functools import partial
from typing import TypeVar

from pymodbus.constants import ExcCodes
from pymodbus.pdu import ExceptionResponse
from pymodbus.pdu.register_message import ReadHoldingRegistersResponse, ReadInputRegistersResponse

from daq.protocol.bus import Bus, BusMember
from daq.protocol.conversation import Conversation, ConversationStep, Fault, FaultKind, Host, Sample
from daq.protocol.framing import Message
from daq.protocol.modbus import (
    ReadBlock,
    Wire,
    exception_of,
    pack,
    registers_of,
    silent_interval_ns,
    unpack,
)
from daq.protocol.polled import Polled, Reply, Then
from rigs.schema.modbus import ModbusMap, RegisterBlock, SolartronOrbit, StatusRegister

Registers = Sequence[int]
Reading = Callable[[Registers, Message, int], Sample | Fault]
"""Interprets the registers of a block, given the message and the time of the request."""
Held = Callable[[int], list[int] | None]
GaugeT = TypeVar("GaugeT", ModbusMap, SolartronOrbit)

_REMEDY = {
    ExcCodes.ILLEGAL_FUNCTION: "set `function` to 3 or 4 as the manual says",
    ExcCodes.ILLEGAL_ADDRESS: "check `address` and `count` against the register map",
    ExcCodes.ILLEGAL_VALUE: "check `count` against the register map",
    ExcCodes.DEVICE_FAILURE: "see the display or the manual",
    ExcCodes.DEVICE_BUSY: "rig repeats the request; does a different program read it?",
    ExcCodes.GATEWAY_PATH_UNAVIABLE: "check the gateway's settings and `unit`",
    ExcCodes.GATEWAY_NO_RESPONSE: "check the cable behind the gateway and `unit`",
}
_PREFIX = 9
"""Bytes before the registers in a TCP answer: transaction, protocol, length, unit, function, size."""
_DAMAGED = "checksum wrong; check the cable and the line settings"
_RESPONSE = {3: ReadHoldingRegistersResponse, 4: ReadInputRegistersResponse}


def on_one_wire(gauges: Sequence[GaugeT], exchange: Callable[[GaugeT, Wire, bool], Polled]) -> Host:
    """Host side of a line with these gauges.

    exchange: creates the exchange of a gauge; its last argument is True if the line is shared.
    """
    first, shared = gauges[0], len(gauges) > 1
    wire = Wire(first.port, first.framing, serving=False)
    exchanges = [exchange(gauge, wire, shared) for gauge in gauges]
    if not shared:
        return exchanges[0]
    members = [
        BusMember(gauge.place, of, round(gauge.timeout_s * 1e9)) for gauge, of in zip(gauges, exchanges, strict=True)
    ]
    gap_ns = 0 if wire.numbered else silent_interval_ns(first.line)
    return Bus(members, wire.frames, partial(unasked, wire), gap_ns)


class RegisterDialect:
    reset, formats = b"", ()
    check = "check the cable, the power supply of the instrument, the line settings and `unit`"
    babble = "a Modbus unit never sends unprompted: disconnect the other master from this line, or check the wiring"

    def __init__(self, block: ReadBlock, reading: Reading, wire: Wire) -> None:
        self._block = block
        self._reading = reading
        self._wire = wire
        self._resync = wire.resync_of(block)
        self.frames = wire.frames
        self._requests: dict[int, bytes] = {}
        size = 2 * block.count
        self._plainly = struct.pack(">HHBBB", 0, 3 + size, block.unit, block.function, size)
        """Expected head of a valid answer for the complete block, after the transaction id."""
        self._words = struct.Struct(f">{block.count}H")
        self._sent, self._count = b"", block.count

    def request(self) -> bytes:
        if not self._wire.numbered:
            self._count = self._resync.ask(self._block.count)
        if self._count not in self._requests:
            b = self._block
            self._requests[self._count] = self._wire.request(b.unit, b.function, b.address, self._count)
        self._sent = self._wire.numbering(self._requests[self._count])
        return self._sent

    def read(self, message: Message, requested_ns: int) -> Reply:
        data = message.data
        if self._wire.numbered and data[:_PREFIX] == self._sent[:2] + self._plainly:  # the usual case
            return self._meant(self._words.unpack_from(data, _PREFIX), message, requested_ns)
        return self._examined(message, requested_ns)

    def _examined(self, message: Message, requested_ns: int) -> Reply:
        is_echo = self._wire.is_echo(message.data, self._sent)
        if is_echo or self._wire.asks(message.data) is not None:
            return Reply((), Then.WAIT) if is_echo else Reply((unasked(self._wire, message),), Then.DRAIN)
        unit, number, content = self._wire.open(message.data)
        expected = int.from_bytes(self._sent[:2], "big") if self._wire.numbered else number
        if not content:
            return _garbled(_DAMAGED, message)
        if number != expected:
            detail = f"answer {number} arrived instead of {expected}; increase timeout_s"
            return Reply((message.fault(FaultKind.LATE, detail),), Then.WAIT)
        function, block = content[0] & 0x7F, self._block
        if (unit, function) == (block.unit, block.function):
            return self._answer(content, message, requested_ns)
        if unit != block.unit and self._wire.owes(unit):
            return Reply((unasked(self._wire, message),), Then.WAIT)
        asked = f"unit {block.unit}, function {block.function}; check `unit`, and the unit table of the gateway"
        return _garbled(f"unit {unit}, function {function} answered instead of {asked}", message)

    def _answer(self, content: bytes, message: Message, requested_ns: int) -> Reply:
        resync = self._resync
        refusal, registers = exception_of(content), registers_of(content)
        mismatched = refusal is None and (registers is None or len(registers) != self._count)
        if mismatched and (
            self._wire.numbered or registers is None or len(registers) not in (*resync.usual, *resync.counts)
        ):
            return _garbled(f"{message.size} bytes in answer to a read of {self._count} registers", message)
        if mismatched:
            detail = "a late answer, recognised by the length, was ignored; increase timeout_s"
            return Reply((message.fault(FaultKind.LATE, detail),), Then.WAIT)
        resync.answered()
        if resync.probing:
            return Reply(())
        if resync.doubtful:
            detail = "an answer, possibly to an earlier request, was ignored; increase timeout_s"
            return Reply((message.fault(FaultKind.LATE, detail),), Then.DRAIN)
        if registers is None:
            code = refusal or 0
            detail = f"unknown Modbus exception {code}; see the instrument's manual"
            if code in list(ExcCodes):
                remedy = _REMEDY.get(ExcCodes(code), "see the instrument's manual")
                detail = f"exception {code} {ExcCodes(code).name}: {remedy}"
            return Reply((message.fault(FaultKind.DEVICE_ERROR, detail),), Then.PAUSE)
        return self._meant(registers, message, requested_ns)

    def _meant(self, registers: Registers, message: Message, requested_ns: int) -> Reply:
        item = self._reading(registers, message, requested_ns)
        return Reply((item,), Then.ASK if isinstance(item, Sample) else Then.PAUSE)


def unasked(wire: Wire, message: Message) -> Fault:
    if (asked := wire.asks(message.data)) is not None:
        detail = f"another master polls unit {asked} on this line; disconnect it, or let it read for both"
        return message.fault(FaultKind.STRANGER, detail)
    unit, _, content = wire.open(message.data)
    if not content:
        return message.fault(FaultKind.GARBLED, _DAMAGED)
    if wire.owes(unit):
        detail = f"a late answer of unit {unit} was ignored; increase the timeout_s of that gauge"
        return message.fault(FaultKind.LATE, detail)
    detail = f"unit {unit} answers, and was not asked from here; is there a different master?"
    return message.fault(FaultKind.STRANGER, detail)


def verdict(
    registers: Registers, status: StatusRegister | None, layout: RegisterBlock, message: Message
) -> int | Fault:
    """0 for a good status of the instrument, the code of a doubtful one, or a fault."""
    if status is None:
        return 0
    code = unpack(registers, status, layout)
    if code in status.good:
        return 0
    if code in status.doubtful:
        return int(code)
    detail = f"status {code:g} is an error of the instrument; see the manual, or list it in `status`"
    return message.fault(FaultKind.DEVICE_ERROR, detail)


def pack_verdict(registers: list[int], status: StatusRegister | None, layout: RegisterBlock, *, good: bool) -> None:
    if status is not None:
        listed = (*status.good, *status.doubtful)
        pack(registers, status, layout, listed[0] if good else min(set(range(len(listed) + 1)) - set(listed)))


def _garbled(detail: str, message: Message) -> Reply:
    return Reply((message.fault(FaultKind.GARBLED, detail),), Then.DRAIN)


class RegisterDevice(Conversation):
    def __init__(
        self, served: Sequence[tuple[ReadBlock, Held]], silently: Sequence[tuple[ReadBlock, Held]] = ()
    ) -> None:
        """served: blocks with their content, None without reading and status. silently: blocks without readings."""
        self.sent = 0
        first = served[0][0]
        self._blocks = [*served, *silently]
        self._readings = len(served)
        self._wire = Wire(first.port, first.framing, serving=True)

    def received(self, data: bytes, now_ns: int) -> ConversationStep:
        answers = b""
        for message in self._wire.frames.feed(data, now_ns):
            if isinstance(message, Fault):
                return ConversationStep(answers, hang_up=True)
            answers += self._answer(message.data, now_ns)
        return ConversationStep(answers)

    def _answer(self, frame: bytes, now_ns: int) -> bytes:
        unit, number, content = self._wire.open(frame)
        if not content or all(unit != block.unit for block, _ in self._blocks):
            return b""
        function, refusal = content[0], ExcCodes.ILLEGAL_FUNCTION
        for place, (block, content_at) in enumerate(self._blocks):
            if (block.unit, block.function) != (unit, function):
                continue
            request = self._wire.decode(content)
            refusal = ExcCodes.ILLEGAL_VALUE if request is None else ExcCodes.ILLEGAL_ADDRESS
            start = request.address - block.address if request else -1
            if request is None or start < 0 or start + request.count > block.count:
                continue
            registers = content_at(now_ns)
            if registers is None:
                refusal = ExcCodes.DEVICE_FAILURE
                break
            self.sent += place < self._readings
            asked = registers[start : start + request.count]
            return self._wire.encode(_RESPONSE[function](registers=asked, dev_id=unit, transaction_id=number))
        return self._wire.encode(ExceptionResponse(function & 0x7F, refusal, unit, number))

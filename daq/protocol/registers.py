"""Reading a block of Modbus registers, and serving one: what gauges and controllers with registers have in common.

The block is read whole in one request, because a value of several registers may not be split (Baumer OM20/OM30
manual p. 22, confirmed) and what it holds must be of the same instant. Over TCP the transaction id marks an old answer.
An RTU answer carries no number, so after a time-out the line is drained (`daq.protocol.polled`), and lest the answer
come later still, a read of another length comes next, whose answer cannot be mistaken (`daq.protocol.resync`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from pymodbus.constants import ExcCodes
from pymodbus.pdu import ExceptionResponse
from pymodbus.pdu.register_message import ReadHoldingRegistersResponse, ReadInputRegistersResponse

from daq.protocol.conversation import Fault, FaultKind, Sample, Step
from daq.protocol.framing import Message
from daq.protocol.modbus import Block, Wire, exception_of, registers_of
from daq.protocol.polled import Reply, Then
from daq.protocol.register_values import pack, unpack
from daq.protocol.resync import Resync
from rigs.schema.modbus import StatusRegister

Registers = Sequence[int]
Reading = Callable[[Registers, Message, int], Sample | Fault]
"""What the block's registers mean, with the message they came in and when it was asked for."""
Held = Callable[[int], list[int] | None]
"""All registers of a block as of a time."""

_REMEDY = {
    ExcCodes.ILLEGAL_FUNCTION: "set `function` to 3 or 4 as its manual says",
    ExcCodes.ILLEGAL_ADDRESS: "check `address` and `count` against its register map",
    ExcCodes.ILLEGAL_VALUE: "check `count` against its register map",
    ExcCodes.DEVICE_FAILURE: "see its display or its manual",
    ExcCodes.DEVICE_BUSY: "it is asked again; is something else reading it?",
    ExcCodes.GATEWAY_PATH_UNAVIABLE: "check the gateway's settings and `unit`",
    ExcCodes.GATEWAY_NO_RESPONSE: "check the cable behind the gateway and `unit`",
}
_RESPONSE = {3: ReadHoldingRegistersResponse, 4: ReadInputRegistersResponse}


class RegisterDialect:
    """The host's dialect, which reads the block."""

    reset = b""
    check = "check the cable, that the instrument is on, the line's settings and `unit`"

    def __init__(self, block: Block, reading: Reading, resync: Resync | None = None) -> None:
        """resync: that of another block which is read over the same line in turn."""
        self._block = block
        self._reading = reading
        self._wire = Wire(block, serving=False, resync=resync)
        self.resync = self._wire.resync
        self.frames = self._wire.frames
        self._number = 0

    def request(self) -> bytes:
        self._number = self._number % 0xFFFF + 1
        return self._wire.request(self._number)

    def read(self, message: Message, requested_ns: int) -> Reply:
        at_ns = message.last_byte_ns
        unit, number, content = self._wire.open(message.data)
        if not content:
            return _garbled("checksum wrong; check the cable and the line's settings", at_ns)
        if self._wire.numbered and number != self._number:
            detail = f"answer {number} came while waiting for {self._number}; increase timeout_s"
            return Reply((Fault(FaultKind.LATE, at_ns, detail),), Then.WAIT)
        if unit != self._block.unit or content[0] & 0x7F != self._block.function:
            return _garbled(f"answer of unit {unit}, function {content[0] & 0x7F}; check `unit`", at_ns)
        return self._answer(content, message, requested_ns)

    def _answer(self, content: bytes, message: Message, requested_ns: int) -> Reply:
        """What a sound answer of this instrument means, or one to an earlier request."""
        at_ns, resync = message.last_byte_ns, self.resync
        refusal, registers = exception_of(content), registers_of(content)
        known = refusal is not None or registers is not None
        other = refusal is None and len(registers or ()) != resync.asked
        if not known or (other and self._wire.numbered):
            return _garbled(f"{message.size} bytes answer a read of {self._block.count} registers", at_ns)
        if other:
            detail = "an answer came too late, recognised by its length, and was ignored; increase timeout_s"
            return Reply((Fault(FaultKind.LATE, at_ns, detail),), Then.WAIT)
        resync.answered()
        if resync.probing:
            return Reply(())
        if resync.doubtful:
            detail = "an answer came that may belong to an earlier request, and was ignored; increase timeout_s"
            return Reply((Fault(FaultKind.LATE, at_ns, detail),), Then.DRAIN)
        if registers is None:
            return Reply((_refusal(refusal or 0, at_ns),), Then.PAUSE)
        item = self._reading(registers, message, requested_ns)
        return Reply((item,), Then.ASK if isinstance(item, Sample) else Then.PAUSE)


def verdict(registers: Registers, status: StatusRegister | None, block: Block, at_ns: int) -> int | Fault:
    """Return the instrument's own verdict: 0 for good, its code for doubtful, a fault for anything else."""
    if status is None:
        return 0
    code = unpack(registers, status, block)
    if code in status.good:
        return 0
    if code in status.doubtful:
        return int(code)
    detail = f"status {code:g} is an error of the instrument; see its manual, or list it in `status`"
    return Fault(FaultKind.DEVICE_ERROR, at_ns, detail)


def pack_verdict(registers: list[int], status: StatusRegister | None, block: Block, *, good: bool) -> None:
    """Put a status into the block: the first listed one if `good`, else one that is not listed."""
    if status is not None:
        known = (*status.good, *status.doubtful)
        pack(registers, status, block, known[0] if good else min(set(range(len(known) + 1)) - set(known)))


def _garbled(detail: str, at_ns: int) -> Reply:
    return Reply((Fault(FaultKind.GARBLED, at_ns, detail),), Then.DRAIN)


def _refusal(code: int, at_ns: int) -> Fault:
    if code not in list(ExcCodes):
        return Fault(FaultKind.DEVICE_ERROR, at_ns, f"exception {code}, unknown to Modbus; see the instrument's manual")
    name = ExcCodes(code)
    remedy = _REMEDY.get(name, "see the instrument's manual")
    return Fault(FaultKind.DEVICE_ERROR, at_ns, f"exception {code} {name.name}: {remedy}")


class RegisterDevice:
    """The instrument's side: it serves one block, or several."""

    def __init__(self, block: Block, registers: Held, *further: tuple[Block, Held]) -> None:
        """registers: the whole block as of a time; None where there is not a reading and nothing to say so with."""
        self.sent = 0
        """Answers from the first block."""
        self._block = block
        self._blocks = ((block, registers), *further)
        self._wire = Wire(block, serving=True)

    def connected(self, now_ns: int) -> Step:
        return Step()

    def received(self, data: bytes, now_ns: int) -> Step:
        answers = b""
        for message in self._wire.frames.feed(data, now_ns):
            if isinstance(message, Fault):
                return Step(answers, hang_up=True)
            answers += self._answer(message.data, now_ns)
        return Step(answers)

    def tick(self, now_ns: int) -> Step:
        return Step()

    def _answer(self, frame: bytes, now_ns: int) -> bytes:
        unit, number, content = self._wire.open(frame)
        if unit != self._block.unit or not content:
            return b""
        result = self._asked(content, now_ns)
        if isinstance(result, ExcCodes):
            return self._wire.encode(ExceptionResponse(content[0] & 0x7F, result, unit, number))
        kind = _RESPONSE[self._block.function]
        return self._wire.encode(kind(registers=result, dev_id=unit, transaction_id=number))

    def _asked(self, content: bytes, now_ns: int) -> list[int] | ExcCodes:
        """What the request asks for, or why not."""
        if content[0] != self._block.function:
            return ExcCodes.ILLEGAL_FUNCTION
        request = self._wire.decode(content)
        if request is None:
            return ExcCodes.ILLEGAL_VALUE
        for block, held in self._blocks:
            start = request.address - block.address
            if start < 0 or start + request.count > block.count:
                continue
            registers = held(now_ns)
            if registers is None:
                return ExcCodes.DEVICE_FAILURE
            self.sent += block is self._block
            return registers[start : start + request.count]
        return ExcCodes.ILLEGAL_ADDRESS

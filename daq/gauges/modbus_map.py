"""Any Modbus gauge by its register map: one read of the whole block for each reading, RTU or TCP.

One read, because a value of several registers may not be split (Baumer OM20/OM30 manual p. 22, confirmed)
and the reading, its status and its clock must be of the same instant. An RTU answer carries no number, so
after a time-out the line is drained (`daq.protocol.polled`); over TCP the transaction id tells an old answer too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from pymodbus.constants import ExcCodes
from pymodbus.pdu import ExceptionResponse
from pymodbus.pdu.register_message import ReadHoldingRegistersResponse, ReadInputRegistersResponse

from daq.gauges import Read
from daq.protocol.conversation import Conversation, Device, Fault, FaultKind, Sample, Step
from daq.protocol.framing import Message
from daq.protocol.modbus import Wire, pack, unpack
from daq.protocol.polled import Heard, Polled, Then
from rigs.gauges import MM_PER_UNIT, ModbusMap, Register

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


def host(gauges: Sequence[ModbusMap]) -> Conversation:
    """Our side; one gauge a link."""
    (gauge,) = gauges
    return Polled(_Asking(gauge), gauge.timeout_s, gauge.rate_hz)


def device(gauges: Sequence[ModbusMap], read: Read) -> Device:
    """The gauge's side."""
    (gauge,) = gauges
    return _Gauge(gauge, read)


class _Asking:
    """The read of the block, and what its registers mean."""

    reset = b""
    check = "check the cable, that the gauge is on, the line's settings and `unit`"

    def __init__(self, gauge: ModbusMap) -> None:
        self._gauge = gauge
        self._wire = Wire(gauge, serving=False)
        self.frames = self._wire.frames
        self._number = 0

    def request(self) -> bytes:
        self._number = self._number % 0xFFFF + 1
        return self._wire.request(self._number)

    def read(self, message: Message, requested_ns: int) -> Heard:
        at_ns = message.last_byte_ns
        unit, number, content = self._wire.open(message.data)
        if not content:
            return _garbled("checksum wrong; check the cable and the line's settings", at_ns)
        if self._wire.numbered and number != self._number:
            detail = f"answer {number} came while waiting for {self._number}; make timeout_s longer"
            return Heard((Fault(FaultKind.LATE, at_ns, detail),), Then.WAIT)
        if unit != self._gauge.unit or content[0] & 0x7F != self._gauge.function:
            return _garbled(f"answer of unit {unit}, function {content[0] & 0x7F}; check `unit`", at_ns)
        pdu = self._wire.decode(content)
        if pdu is None or (not pdu.isError() and len(pdu.registers) != self._gauge.count):
            return _garbled(f"{message.size} bytes answer a read of {self._gauge.count} registers", at_ns)
        if pdu.isError():
            return Heard((_refusal(pdu.exception_code, at_ns),), Then.PAUSE)
        item = self._reading(pdu.registers, message, requested_ns)
        return Heard((item,), Then.ASK if isinstance(item, Sample) else Then.PAUSE)

    def _reading(self, registers: Sequence[int], message: Message, requested_ns: int) -> Sample | Fault:
        gauge, at_ns = self._gauge, message.last_byte_ns
        code = 0.0
        if gauge.status is not None:
            code = unpack(registers, gauge.status, gauge)
            if code not in (*gauge.status.good, *gauge.status.doubtful):
                detail = f"status {code:g} is an error of the gauge; see its manual, or list it in `status`"
                return Fault(FaultKind.DEVICE_ERROR, at_ns, detail)
            code = 0 if code in gauge.status.good else code
        raw = unpack(registers, gauge.value, gauge)
        value_mm = (raw * gauge.value.scale + gauge.value.offset) * MM_PER_UNIT[gauge.units]
        if not math.isfinite(value_mm):
            return Fault(FaultKind.DEVICE_ERROR, at_ns, f"the gauge reads {raw}; check the head and `value`")
        return Sample(
            (value_mm,),
            requested_ns,
            message.first_byte_ns,
            at_ns,
            message.size,
            self._clock_s(registers),
            int(code),
        )

    def _clock_s(self, registers: Sequence[int]) -> float:
        parts = [(self._gauge.clock_s, 1.0), (self._gauge.clock_us, 1e-6)]
        known = [unpack(registers, part, self._gauge) * scale for part, scale in parts if part is not None]
        return sum(known) if known else math.nan


def _garbled(detail: str, at_ns: int) -> Heard:
    return Heard((Fault(FaultKind.GARBLED, at_ns, detail),), Then.DRAIN)


def _refusal(code: int, at_ns: int) -> Fault:
    if code not in list(ExcCodes):
        return Fault(FaultKind.DEVICE_ERROR, at_ns, f"exception {code}, unknown to Modbus; see the gauge's manual")
    name = ExcCodes(code)
    remedy = _REMEDY.get(name, "see the gauge's manual")
    return Fault(FaultKind.DEVICE_ERROR, at_ns, f"exception {code} {name.name}: {remedy}")


class _Gauge:
    """The instrument: it holds the block and nothing else."""

    def __init__(self, gauge: ModbusMap, read: Read) -> None:
        self.sent = 0
        self._gauge = gauge
        self._read = read
        self._wire = Wire(gauge, serving=True)

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
        if unit != self._gauge.unit or not content:
            return b""
        result = self._registers(content, now_ns)
        if isinstance(result, ExcCodes):
            return self._wire.encode(ExceptionResponse(content[0] & 0x7F, result, unit, number))
        self.sent += 1
        kind = _RESPONSE[self._gauge.function]
        return self._wire.encode(kind(registers=result, dev_id=unit, transaction_id=number))

    def _registers(self, content: bytes, now_ns: int) -> list[int] | ExcCodes:
        """What the request asks for, or why not."""
        if content[0] != self._gauge.function:
            return ExcCodes.ILLEGAL_FUNCTION
        request = self._wire.decode(content)
        if request is None:
            return ExcCodes.ILLEGAL_VALUE
        start = request.address - self._gauge.address
        if start < 0 or start + request.count > self._gauge.count:
            return ExcCodes.ILLEGAL_ADDRESS
        block = self._block(now_ns)
        return ExcCodes.DEVICE_FAILURE if block is None else block[start : start + request.count]

    def _block(self, now_ns: int) -> list[int] | None:
        """All registers; None where there is no reading and no status register to say so."""
        gauge = self._gauge
        raw = (self._read(now_ns)[0] / MM_PER_UNIT[gauge.units] - gauge.value.offset) / gauge.value.scale
        good = _fits(raw, gauge.value)
        if not good and gauge.status is None:
            return None
        block = [0] * gauge.count
        pack(block, gauge.value, gauge, raw if good else 0)
        if gauge.status is not None:
            known = (*gauge.status.good, *gauge.status.doubtful)
            pack(block, gauge.status, gauge, known[0] if good else min(set(range(len(known) + 1)) - set(known)))
        seconds, rest_ns = divmod(now_ns, 1_000_000_000)
        for register, value in ((gauge.clock_s, seconds), (gauge.clock_us, rest_ns // 1000)):
            if register is not None:
                pack(block, register, gauge, value)
        return block


def _fits(raw: float, register: Register) -> bool:
    """Whether the register's type can hold it."""
    if register.type == "float32":
        return abs(raw) < 2.0**127
    bits, signed = 16 * register.count, register.type.startswith("int")
    lowest, span = (-(1 << bits - 1) if signed else 0), 1 << bits
    return lowest <= round(raw) < lowest + span if math.isfinite(raw) else False

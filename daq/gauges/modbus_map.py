"""Any Modbus gauge by its register map: one read of the whole block for each reading, RTU or TCP."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

from daq.gauges import Read
from daq.protocol.conversation import Device, Fault, FaultKind, Host, Sample
from daq.protocol.framing import Message
from daq.protocol.modbus import fits, pack, unpack
from daq.protocol.polled import Polled
from daq.protocol.registers import Held, RegisterDevice, RegisterDialect, Registers, pack_verdict, verdict
from daq.protocol.resync import Resync
from rigs.schema.modbus import ModbusMap
from rigs.schema.probe import MM_PER_UNIT


def host(gauges: Sequence[ModbusMap]) -> Host:
    """Return our side of the conversation; a link carries one gauge."""
    (gauge,) = gauges
    return Polled(dialect(gauge), gauge.timeout_s, gauge.rate_hz)


def device(gauges: Sequence[ModbusMap], read: Read) -> Device:
    """Return the gauge's side of the conversation."""
    (gauge,) = gauges
    return RegisterDevice(gauge, held(gauge, read))


def dialect(gauge: ModbusMap, resync: Resync | None = None) -> RegisterDialect:
    """Return the dialect that reads this block; `resync`: see `RegisterDialect`."""
    return RegisterDialect(gauge, partial(_reading, gauge), resync)


def held(gauge: ModbusMap, read: Read) -> Held:
    """Return what the instrument's block holds, as a function of time."""
    return lambda now_ns: _registers(gauge, read(now_ns)[0], now_ns)


def _reading(gauge: ModbusMap, registers: Registers, message: Message, requested_ns: int) -> Sample | Fault:
    at_ns = message.last_byte_ns
    code = verdict(registers, gauge.status, gauge, at_ns)
    if isinstance(code, Fault):
        return code
    raw = unpack(registers, gauge.value, gauge)
    value_mm = (raw * gauge.value.scale + gauge.value.offset) * MM_PER_UNIT[gauge.units]
    if not math.isfinite(value_mm):
        return Fault(FaultKind.DEVICE_ERROR, at_ns, f"the gauge reads {raw}; check the head and `value`")
    clock_s = _clock_s(gauge, registers)
    return Sample((value_mm,), requested_ns, message.first_byte_ns, at_ns, message.size, clock_s, code)


def _clock_s(gauge: ModbusMap, registers: Registers) -> float:
    parts = [(gauge.clock_s, 1.0), (gauge.clock_us, 1e-6)]
    known = [unpack(registers, part, gauge) * scale for part, scale in parts if part is not None]
    return sum(known) if known else math.nan


def _registers(gauge: ModbusMap, reading_mm: float, now_ns: int) -> list[int] | None:
    """All registers; None where there is not a reading and no status register to say so."""
    raw = (reading_mm / MM_PER_UNIT[gauge.units] - gauge.value.offset) / gauge.value.scale
    good = fits(raw, gauge.value)
    if not good and gauge.status is None:
        return None
    registers = [0] * gauge.count
    pack(registers, gauge.value, gauge, raw if good else 0)
    pack_verdict(registers, gauge.status, gauge, good=good)
    seconds, rest_ns = divmod(now_ns, 1_000_000_000)
    for register, value in ((gauge.clock_s, seconds), (gauge.clock_us, rest_ns // 1000)):
        if register is not None:
            pack(registers, register, gauge, value)
    return registers

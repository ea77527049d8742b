"""Any Modbus gauge described by a register map. Each reading is a single read of the complete block by RTU or TCP."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product
from typing import get_args

from daq.gauges import Read
from daq.protocol.conversation import Device, Fault, FaultKind, Host, Sample
from daq.protocol.framing import Message
from daq.protocol.modbus import Wire, fits, pack, unpack
from daq.protocol.numerals import refusal
from daq.protocol.polled import Polled
from daq.protocol.registers import Held, RegisterDevice, RegisterDialect, Registers, on_one_wire, pack_verdict, verdict
from rigs.schema.modbus import ModbusMap, Order
from rigs.schema.probe import MM_PER_UNIT

_BELIEVED = 20
"""Consecutive plausible lengths that confirm the byte order.

A third of the numbers in a wrong order are also lengths. The numbers of a slowly moving probe are not independent: at
least as many are required as there were implausible numbers.
"""
_FINE_MM = 1e-6
"""Smallest plausible reading except 0. Smaller numbers confirm no byte order, and are doubted if they persist."""


def host(gauges: Sequence[ModbusMap]) -> Host:
    def exchange(gauge: ModbusMap, wire: Wire, shared: bool) -> Polled:
        return Polled(dialect(gauge, wire), gauge.timeout_s, gauge.rate_hz, shared=shared)

    return on_one_wire(gauges, exchange)


def device(gauges: Sequence[ModbusMap], read: Read) -> Device:
    return RegisterDevice([(gauge, registers_over_time(gauge, read, place)) for place, gauge in enumerate(gauges)])


def dialect(gauge: ModbusMap, wire: Wire) -> RegisterDialect:
    return RegisterDialect(gauge, _Readings(gauge), wire)


def registers_over_time(gauge: ModbusMap, read: Read, place: int = 0) -> Held:
    """Content of the block as a function of time. place: index of the reading of this gauge."""
    return lambda now_ns: _registers(gauge, read(now_ns)[place], now_ns)


class _Readings:
    def __init__(self, gauge: ModbusMap) -> None:
        self._gauge = gauge
        self._mistrusted = 0
        self._fine = True
        """True if the last number was below _FINE_MM, and initially."""

    def __call__(self, registers: Registers, message: Message, requested_ns: int) -> Sample | Fault:
        gauge = self._gauge
        code = verdict(registers, gauge.status, gauge, message)
        if isinstance(code, Fault):
            return code
        raw = unpack(registers, gauge.value, gauge)
        if not math.isfinite(raw):
            return message.fault(FaultKind.DEVICE_ERROR, f"the gauge reads {raw}; check the head and `value`")
        value_mm = _mm(raw, gauge)
        refused = self._refusal(value_mm, registers)
        if refused and refused[0] is FaultKind.GARBLED:
            self._mistrusted = max(_BELIEVED, self._mistrusted + 1)
            return message.fault(FaultKind.GARBLED, refused[1])
        if self._mistrusted:
            self._mistrusted -= 1
            detail = f"{value_mm:.4g} mm is ignored after an impossible number; check `word_order` and `byte_order`"
            return message.fault(FaultKind.GARBLED, detail)
        if refused:
            return message.fault(*refused)
        parts = [(part, scale) for part, scale in ((gauge.clock_s, 1.0), (gauge.clock_us, 1e-6)) if part is not None]
        clock_s = sum(unpack(registers, part, gauge) * scale for part, scale in parts) if parts else math.nan
        clock_s = clock_s if math.isfinite(clock_s) else math.nan
        return message.sample((value_mm,), clock_s, requested_ns=requested_ns, status=code)

    def _refusal(self, value_mm: float, registers: Registers) -> tuple[FaultKind, str] | None:
        """Why the number is rejected, by itself or as a repeated value below a nanometre.

        A probe at rest with swapped bytes may repeatedly give such a small number. A rounding error may do so too, but
        is hardly a length in a different order.
        """
        fine_before, self._fine = self._fine, 0 < abs(value_mm) < _FINE_MM
        refused = refusal(value_mm, self._gauge)
        if refused and refused[0] is not FaultKind.GARBLED:
            return refused
        if not refused and not (fine_before and self._fine):
            return None
        orders = _in_other_orders(registers, self._gauge)
        if not refused and not orders:
            return None
        problem = refused[1] if refused else f"repeated implausible readings, such as {value_mm:.3g} mm; check `units`"
        would = f"; alternatively {' or '.join(orders)}" if orders else ""
        return FaultKind.GARBLED, f"{problem}, `word_order`, `byte_order` and `value`{would}"


def _mm(raw: float, gauge: ModbusMap) -> float:
    return (raw * gauge.value.scale + gauge.value.offset) * MM_PER_UNIT[gauge.units]


def _in_other_orders(registers: Registers, gauge: ModbusMap) -> list[str]:
    readings = []
    for word_order, byte_order in product(get_args(Order), repeat=2):
        orders: dict[str, Order] = {"word_order": word_order, "byte_order": byte_order}
        changed = {key: order for key, order in orders.items() if order != getattr(gauge, key)}
        if not changed or (gauge.value.count == 1 and "word_order" in changed):
            continue
        value_mm = _mm(unpack(registers, gauge.value, gauge.model_copy(update=changed)), gauge)
        if abs(value_mm) > _FINE_MM and refusal(value_mm, gauge) is None:
            readings.append(f"{value_mm:.4g} mm with {', '.join(f'{key}: {order}' for key, order in changed.items())}")
    return readings


def _registers(gauge: ModbusMap, reading_mm: float, now_ns: int) -> list[int] | None:
    """All registers; None if there is neither a reading nor a status register."""
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

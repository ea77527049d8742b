"""Solartron Orbit ACS: a reading and its status, which are two parameters read in sequence.

A parameter is a float32 in two registers, starting at the parameter address + 8000. It must be read completely, in a
separate read. The status validates the reading (manual p. 32, 48-54, confirmed). Each sample therefore takes two
requests and has the stamps of the first. An error may end between the two, so the first reading of a connection and
the first after an error are not recorded. Function, word order, the float32 type of the status, and the line settings
are not confirmed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from daq.gauge_drivers.modbus_map import dialect, registers_over_time
from daq.gauges import Read
from daq.protocol.conversation import Device, Fault, FaultKind, Host, Sample
from daq.protocol.framing import Message
from daq.protocol.modbus import Wire
from daq.protocol.numerals import refusal
from daq.protocol.polled import Polled, Reply, Then
from daq.protocol.registers import RegisterDevice, on_one_wire
from rigs.schema.modbus import ModbusMap, SolartronOrbit, ValueRegister

_FLOATS = 8000
_SHARED = ("port", "offset_mm", "units", "line", "framing", "unit", "function", "word_order", "byte_order", "timeout_s")
_NO_PROBE = 247.0
_STATUS = {
    18: "under range; move the probe into the range",
    19: "over range; move the probe into the range",
    246: "an incompatible probe is connected; connect a supported probe",
    247: "no probe is connected; check the plug",
}


def host(gauges: Sequence[SolartronOrbit]) -> Host:
    def exchange(gauge: SolartronOrbit, wire: Wire, shared: bool) -> Polled:
        return Polled(_OrbitDialect(gauge, wire), gauge.timeout_s, shared=shared)

    return on_one_wire(gauges, exchange)


def device(gauges: Sequence[SolartronOrbit], read: Read) -> Device:
    def value(now_ns: int) -> Sequence[float]:
        return [0.0 if math.isnan(value) else value for value in read(now_ns)]

    def status(now_ns: int) -> Sequence[float]:
        return [_NO_PROBE if math.isnan(value) else 0.0 for value in read(now_ns)]

    values = [_block(gauge, gauge.parameter) for gauge in gauges]
    statuses = [_block(gauge, gauge.status_parameter, units="mm") for gauge in gauges]
    return RegisterDevice(
        [(block, registers_over_time(block, value, place)) for place, block in enumerate(values)],
        silently=[(block, registers_over_time(block, status, place)) for place, block in enumerate(statuses)],
    )


def _block(gauge: SolartronOrbit, parameter: int, **changed: str) -> ModbusMap:
    """A parameter as a register map; the status in mm, so that it is not converted."""
    address = _FLOATS + parameter
    return ModbusMap(
        interface="modbus_map",
        address=address,
        count=2,
        value=ValueRegister(address=address, type="float32"),
        **{name: getattr(gauge, name) for name in _SHARED} | changed,
    )


class _OrbitDialect:
    reset, formats = b"", ()

    def __init__(self, gauge: SolartronOrbit, wire: Wire) -> None:
        self._gauge = gauge
        self._value = dialect(_block(gauge, gauge.parameter), wire)
        self._status = dialect(_block(gauge, gauge.status_parameter, units="mm"), wire)
        self.frames = wire.frames
        self.check, self.babble = self._value.check, self._value.babble
        self._held: Sample | None = None
        self._asked: Sample | None = None
        """Reading to be confirmed by the last request; None if that requested a reading."""
        self._was_good = False
        """Whether the latest status known was good. An error may end between a reading and its status."""

    def request(self) -> bytes:
        self._asked, self._held = self._held, None
        return (self._status if self._asked else self._value).request()

    def read(self, message: Message, requested_ns: int) -> Reply:
        if self._asked is None:
            reply = self._value.read(message, requested_ns)
            if reply.then is not Then.ASK or not reply.items:
                return reply
            (item,) = reply.items
            self._held = item if isinstance(item, Sample) else None
            return replace(reply, items=())
        reply = self._status.read(message, requested_ns)
        (item,) = reply.items
        if not isinstance(item, Sample):
            return reply
        code = round(item.values[0])
        was_good, self._was_good = self._was_good, code == 0
        if code == 0:
            return self._confirmed(self._asked) if was_good else Reply(())
        meaning = _STATUS.get(code, "an error of the gauge; see the manual")
        return Reply((Fault(FaultKind.DEVICE_ERROR, item.last_byte_ns, f"status {code}: {meaning}"),), Then.PAUSE)

    def _confirmed(self, reading: Sample) -> Reply:
        """A reading with a good status before and after it, if its value is possible."""
        if refused := refusal(reading.values[0], self._gauge):
            kind, detail = refused
            return Reply((Fault(kind, reading.last_byte_ns, detail),), Then.PAUSE)
        return Reply((reading,))

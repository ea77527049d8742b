"""Our Modbus against libmodbus, an implementation in C that shares nothing with ours; skipped where it is not there.

It has four ways to lay out a float32, whose names its versions do not use alike; so each is known by the registers that
it makes of 123456, 0x47F12000, as libmodbus' own tests do.
"""

import ctypes
import ctypes.util
import os
import tty
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import pytest

import daq.gauges
from daq.acquisition.stream_buffer import faults_of, samples_of
from daq.protocol.conversation import FaultKind, Host, Item, Sample
from rigs.schema.links import Line
from rigs.schema.modbus import ModbusMap
from tests.support.drivers import PLAIN, modbus
from tests.support.simulated_conversation import S, Script

_FOUND = ctypes.util.find_library("modbus") or os.environ.get("LIBMODBUS")
pytestmark = pytest.mark.skipif(_FOUND is None, reason="libmodbus is not installed (apt install libmodbus5)")

LAYOUTS = ("abcd", "badc", "cdab", "dcba")
ORDERS = {
    (0x47F1, 0x2000): ("big", "big"),
    (0xF147, 0x0020): ("big", "little"),
    (0x2000, 0x47F1): ("little", "big"),
    (0x0020, 0xF147): ("little", "little"),
}
FIRST, REGISTERS = 100, 8
LINE = Line.model_validate("115200 8N1")


def _library() -> ctypes.CDLL:
    library = ctypes.CDLL(_FOUND)
    library.modbus_new_tcp.restype = library.modbus_new_rtu.restype = ctypes.c_void_p
    library.modbus_mapping_new_start_address.restype = ctypes.c_void_p
    return library


class _Mapping(ctypes.Structure):
    _fields_ = [
        *(
            (name, ctypes.c_int)
            for name in ("bits", "bits_at", "inputs", "inputs_at", "input_registers", "inputs_from")
        ),
        *((name, ctypes.c_int) for name in ("registers", "registers_at")),
        *((name, ctypes.c_void_p) for name in ("tab_bits", "tab_inputs")),
        *((name, ctypes.POINTER(ctypes.c_uint16)) for name in ("tab_input_registers", "tab_registers")),
    ]


def _mapping(library: ctypes.CDLL, layout: str, value: float) -> ctypes.c_void_p:
    made = ctypes.c_void_p(library.modbus_mapping_new_start_address(0, 0, 0, 0, 0, 0, FIRST, REGISTERS))
    registers = ctypes.cast(made, ctypes.POINTER(_Mapping)).contents.tab_input_registers
    getattr(library, f"modbus_set_float_{layout}")(ctypes.c_float(value), registers)
    return made


@dataclass
class _RtuUnit:
    """A unit of libmodbus behind a terminal. It answers a request when asked to, however slow the computer is."""

    library: ctypes.CDLL
    context: ctypes.c_void_p
    mapping: ctypes.c_void_p
    master: int

    def answer(self, request: bytes) -> bytes:
        """Answer to a request; empty if the unit ignores it, or takes it for the answer of another unit."""
        os.write(self.master, request)
        query = (ctypes.c_uint8 * 260)()
        size = self.library.modbus_receive(self.context, query)
        sent = self.library.modbus_reply(self.context, query, size, self.mapping) if size > 0 else 0
        answer = b""
        while len(answer) < sent:
            answer += os.read(self.master, sent - len(answer))
        return answer


@contextmanager
def _rtu_unit(unit: int, layout: str, value: float) -> Iterator[_RtuUnit]:
    library = _library()
    master, slave = os.openpty()
    tty.setraw(slave)
    context = ctypes.c_void_p(library.modbus_new_rtu(os.ttyname(slave).encode(), 115200, ctypes.c_char(b"N"), 8, 1))
    library.modbus_set_slave(context, unit)
    assert library.modbus_connect(context) == 0
    library.modbus_set_indication_timeout(context, 60, 0)
    library.modbus_set_byte_timeout(context, 0, 50_000)
    try:
        yield _RtuUnit(library, context, _mapping(library, layout, value), master)
    finally:
        library.modbus_close(context)
        for descriptor in (master, slave):
            os.close(descriptor)


def _gauge(layout: str, **changes: object) -> ModbusMap:
    laid = (ctypes.c_uint16 * 2)()
    getattr(_library(), f"modbus_set_float_{layout}")(ctypes.c_float(123456), laid)
    word_order, byte_order = ORDERS[laid[0], laid[1]]
    fields = {
        "port": "/dev/ttyUSB0",
        "unit": 7,
        "address": FIRST,
        "count": 2,
        "value": {"address": FIRST, "type": "float32"},
    }
    orders = {"word_order": word_order, "byte_order": byte_order, "line": str(LINE), "rate_hz": 200, "timeout_s": 0.2}
    return modbus(**(PLAIN | fields | orders | changes))


def _items(host: Host, unit: _RtuUnit, enough: int) -> list[Item]:
    """Items of a host in simulated time. Each answer arrives 5 ms after its request."""
    script = Script(host)
    while len(script.items) < enough:
        request, script.sent = script.sent, b""
        answer = unit.answer(request) if request else b""
        if answer:
            script.receive(answer, script.now_ns + S // 200)
        else:
            script.wake()
    return script.items


def _values(items: Sequence[Item]) -> set[float]:
    assert not faults_of(items), items
    return {round(item.values[0], 4) for item in items if isinstance(item, Sample)}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_each_layout_of_a_float_over_rtu(layout):
    with _rtu_unit(7, layout, -12.3456) as unit:
        assert _values(_items(daq.gauges.host([_gauge(layout)]), unit, 20)) == {-12.3456}


def test_missing_unit_on_a_line_with_libmodbus():
    with _rtu_unit(7, "abcd", 1.25) as unit:
        gauges = [_gauge("abcd"), _gauge("abcd", unit=8, timeout_s=0.05)]
        items = _items(daq.gauges.host(gauges), unit, 60)
    samples = samples_of(items)
    faults = faults_of(items)
    assert {sample.values[0] for sample in samples} == {1.25} and len(samples) > 20
    silent = [fault.detail.partition(":")[0] for fault in faults if fault.kind is FaultKind.SILENT]
    # A unit of libmodbus takes what follows a request to another unit for that one's answer, so it may miss its own.
    assert silent.count("unit 8, input register 100") >= 2 and len(silent) <= 2 * silent.count(silent[0])


def test_its_refusals_are_understood():
    with _rtu_unit(7, "abcd", 1.25) as unit:
        gauge = _gauge("abcd", address=FIRST + REGISTERS, value={"address": FIRST + REGISTERS, "type": "float32"})
        (fault, *_) = _items(daq.gauges.host([gauge]), unit, 1)
    assert "ILLEGAL_ADDRESS" in fault.detail

import math
import struct

import numpy as np
import pytest
from pydantic import ValidationError

import daq.gauges
from daq import gauges
from daq.protocol.conversation import Fault, Sample
from daq.protocol.modbus import fits, pack, unpack
from rigs.schema.modbus import ModbusMap, StatusRegister, ValueRegister
from tests.support.drivers import PLAIN, TCP, modbus
from tests.support.simulated_conversation import Script

NUMPY = {"int": "i", "uint": "u", "float": "f"}
VALUES = {
    "int16": -12345,
    "uint16": 54321,
    "float16": -1.5,
    "int32": -123456789,
    "uint32": 4123456789,
    "float32": 69.743003845,
    "int64": -1234567890123456,
    "uint64": 2**63 + 2**20,
    "float64": -1.2345678901,
}
ORDERS = [("big", "big"), ("big", "little"), ("little", "big"), ("little", "little")]


def _laid(number: float, kind: str, word_order: str, byte_order: str) -> list[int]:
    name, bits = kind[:-2], int(kind[-2:])
    data = np.array([number], dtype=f">{NUMPY[name]}{bits // 8}").tobytes()
    words = [data[k : k + 2] for k in range(0, len(data), 2)]
    ordered = words if word_order == "big" else words[::-1]
    return [int.from_bytes(word, byte_order) for word in ordered]


@pytest.mark.parametrize(("word_order", "byte_order"), ORDERS)
@pytest.mark.parametrize("kind", VALUES)
def test_every_type_in_every_order(kind, word_order, byte_order):
    value = ValueRegister.model_validate({"address": 203, "type": kind})
    block = modbus(value=value, word_order=word_order, byte_order=byte_order, **PLAIN)
    registers = [0xAAAA] * block.count
    laid = _laid(VALUES[kind], kind, word_order, byte_order)
    registers[3 : 3 + len(laid)] = laid
    assert unpack(registers, value, block) == pytest.approx(VALUES[kind], rel=1e-7 if kind == "float32" else 1e-15)
    packed = [0xAAAA] * block.count
    pack(packed, value, block, VALUES[kind])
    assert packed == registers


@pytest.mark.parametrize(
    ("kind", "most", "too_much"),
    [
        ("int16", 32767, 32768),
        ("uint16", 65535, 65536),
        ("int64", 2.0**63 - 1024, 2.0**63),
        ("uint64", 2.0**64 - 2048, 2.0**64),
        ("float16", 65504, 65505),
        ("float32", 3.4028234e38, 3.5e38),
        ("float64", 1.7e308, math.inf),
        ("uint32", 0, -1),
    ],
)
def test_ranges_of_the_types(kind, most, too_much):
    register = ValueRegister.model_validate({"address": 202, "type": kind})
    assert fits(most, register) and not fits(too_much, register) and not fits(math.nan, register)
    pack([0] * 13, register, modbus(), most)


def _float_gauge(**changes: object) -> ModbusMap:
    value = {"address": 200, "type": "float32"}
    return modbus(port=TCP, count=2, word_order="big", value=value, **PLAIN, **changes)


def _answered(script: Script, registers: list[int]) -> Sample | Fault | None:
    """Result of an answer in a conversation; None for a fault merged with others."""
    while not script.step.send:
        script.wake()
    script.taken()
    content = struct.pack(f">BBB{len(registers)}H", 1, 4, 2 * len(registers), *registers)
    script.receive(script.step.send[:4] + len(content).to_bytes(2, "big") + content)
    return next((item for item in script.taken() if isinstance(item, Sample | Fault)), None)


@pytest.mark.parametrize(("word_order", "byte_order"), ORDERS[1:])
def test_a_probe_in_a_wrong_order_that_moves_gives_no_readings(word_order, byte_order):
    """A number in a wrong order can be a length by chance; after one that is none, the next are not believed."""
    script = Script(daq.gauges.host([_float_gauge()]))
    travel_mm = np.random.default_rng(5).permutation(np.linspace(-2, 2, 2001))
    items = [_answered(script, _laid(float(v), "float32", word_order, byte_order)) for v in travel_mm]
    passed = [place for place, item in enumerate(items) if isinstance(item, Sample)]
    assert len(passed) < 20 and all(place < 20 for place in passed)  # before the first that is no length


@pytest.mark.parametrize(("word_order", "byte_order"), ORDERS[1:])
def test_a_slow_probe_in_a_wrong_order_gives_few_readings(word_order, byte_order):
    """A circle moves a gauge by some 0.05 mm, so numbers in a wrong order are lengths for hundreds of readings."""
    motion_mm = 0.05 * np.sin(np.linspace(0, 2 * np.pi, 1001)) + np.random.default_rng(5).normal(0, 0.0005, 1001)
    shares = []
    for middle_mm in np.linspace(-2.4, 2.4, 13):
        script = Script(daq.gauges.host([_float_gauge(range_mm=(-2.5, 2.5))]))
        items = [_answered(script, _laid(float(middle_mm + v), "float32", word_order, byte_order)) for v in motion_mm]
        shares.append(sum(isinstance(item, Sample) for item in items) / len(items))
    assert np.mean(shares) < 0.08, shares


def test_constant_swapped_number_below_a_nanometre_is_a_fault():
    """0.731 mm is 5.7e-18 mm, a rounding error by its size, in each reading of a probe at rest."""
    script = Script(daq.gauges.host([_float_gauge(range_mm=(-2.5, 2.5))]))
    items = [_answered(script, _laid(0.731, "float32", "little", "big")) for _ in range(50)]
    first, *_ = items
    assert not any(isinstance(item, Sample) for item in items)
    assert "0.731 mm" in first.detail and "word_order: little" in first.detail


def test_correct_order_gives_all_readings_through_zero():
    script = Script(daq.gauges.host([_float_gauge()]))
    travel_mm = np.float32(0.3) - np.linspace(0.2, 0.4, 2001, dtype=np.float32)
    items = [_answered(script, _laid(float(v), "float32", "big", "big")) for v in travel_mm]
    assert all(isinstance(item, Sample) for item in items)


def test_a_doubtful_status_that_a_run_cannot_keep_is_refused():
    """A run stores the status in 32 bits, which would turn 2³² into good."""

    def with_doubtful(code: int) -> StatusRegister:
        return StatusRegister.model_validate({"address": 203, "type": "uint64", "doubtful": [code]})

    assert [with_doubtful(code).doubtful for code in (-(2**31), 2**32 - 1)] == [(-(2**31),), (2**32 - 1,)]
    for code in (2**32, 2**63, -(2**31) - 1):
        with pytest.raises(ValidationError, match="doubtful"):
            with_doubtful(code)


MS = 1_000_000
RATE_HZ = 500.0


def _requested_ns(late_ns: int, stall_at_ns: int = -1, stall_ns: int = 0) -> np.ndarray:
    """When a gauge is asked in two seconds by a computer that is late by this at each turn, and once stands still."""
    fields = {"address": 0, "count": 2, "function": 4, "value": {"address": 0, "type": "float32"}, "rate_hz": RATE_HZ}
    common = {"interface": "modbus_map", "port": "tcp://127.0.0.1:502", "offset_mm": 25, "accuracy_mm": 0.01}
    conversation = gauges.host([ModbusMap.model_validate(common | fields)])
    now_ns, asked_ns = 0, list[int]()
    step = conversation.connected(now_ns)
    while now_ns < 3000 * MS:
        if step.send:
            asked_ns.append(now_ns)
            now_ns += 300_000
            step = conversation.received(step.send[:4] + b"\0\7" + step.send[6:8] + b"\4\0\0\0\0", now_ns)
            continue
        now_ns = max(now_ns, step.wake_ns) + late_ns
        if 0 <= stall_at_ns <= now_ns:
            now_ns, stall_at_ns = now_ns + stall_ns, -1
        step = conversation.tick(now_ns)
    return np.array(asked_ns)


@pytest.mark.parametrize("late_ns", [0, 300_000, 1_000_000])
def test_slightly_late_computer_keeps_the_request_rate(late_ns):
    asked_ns = _requested_ns(late_ns)
    asked_ns = asked_ns[asked_ns >= asked_ns[-1] - 2000 * MS]
    rate_hz = (len(asked_ns) - 1) * 1e9 / np.ptp(asked_ns)
    assert 0.97 * RATE_HZ < rate_hz <= 1.001 * RATE_HZ  # but for the pauses that stir the line


def test_stall_is_not_followed_by_a_burst():
    asked_ns = _requested_ns(0, stall_at_ns=2000 * MS, stall_ns=400 * MS)
    afterwards = asked_ns[asked_ns >= 2400 * MS]
    assert np.diff(afterwards).min() >= 0.9e9 / RATE_HZ

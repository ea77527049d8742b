import math
import random
import struct
from collections.abc import Sequence

import pytest
from pymodbus.framer import FramerRTU

import daq.gauges
from daq.acquisition.stream_buffer import faults_of, samples_of
from daq.protocol.conversation import Fault, FaultKind, Host, Item, Sample
from daq.protocol.modbus import silent_interval_ns
from rigs.schema.links import Line
from rigs.schema.modbus import ModbusMap
from tests.support.drivers import PLAIN, gauge, modbus
from tests.support.simulated_conversation import S
from tests.support.simulated_line import SimulatedLine

LINE = Line.model_validate("115200 8E1")
TIMEOUT_S = 0.05
UNITS = 8
FAIR = 0.05
VALUE = {"address": 200, "type": "float32"}


def _unit(number: int, **changes: object) -> ModbusMap:
    fields = {"unit": number, "line": str(LINE), "timeout_s": TIMEOUT_S, "count": 2, "value": VALUE, **PLAIN}
    return modbus(**(fields | changes))


def _eight() -> list[ModbusMap]:
    return [_unit(number) for number in range(1, UNITS + 1)]


def _float32(value: float) -> float:
    (read,) = struct.unpack(">f", struct.pack(">f", value))
    return float(read)


def _samples(items: Sequence[Item], column: int) -> list[Sample]:
    """The samples of one gauge, each of which has nothing of the others."""
    found = [sample for sample in samples_of(items) if not math.isnan(sample.values[column])]
    assert all(sum(map(math.isfinite, sample.values)) == 1 for sample in found)
    return found


def _faults(items: Sequence[Item], kind: FaultKind) -> list[Fault]:
    return [item for item in items if isinstance(item, Fault) and item.kind is kind]


def _simulated(host: Host, units: Sequence[ModbusMap], seconds: int, line: SimulatedLine | None = None) -> list[Item]:
    device = daq.gauges.device(units, lambda now_ns: [unit.unit / 100 for unit in units])
    line = line or SimulatedLine(LINE.character_ns, silent_interval_ns(LINE))
    return line.run(host, device, seconds * S)


def test_eight_units_are_polled_equally_with_correct_values():
    line = SimulatedLine(LINE.character_ns, silent_interval_ns(LINE))
    items = _simulated(daq.gauges.host(_eight()), _eight(), 20, line)
    counts = [len(_samples(items, column)) for column in range(UNITS)]
    assert max(counts) - min(counts) <= 1 and min(counts) > 20 * 15
    assert not faults_of(items) and line.unheard == 0
    for column in range(UNITS):
        assert {sample.values[column] for sample in _samples(items, column)} == {_float32((column + 1) / 100)}


def test_dead_unit_costs_only_its_time_outs():
    seconds = 20
    items = _simulated(daq.gauges.host(_eight()), [unit for unit in _eight() if unit.unit != 3], seconds)
    without = _simulated(daq.gauges.host([u for u in _eight() if u.unit != 3]), _eight(), seconds)
    silent = _faults(items, FaultKind.SILENT)
    assert all(fault.detail.startswith("unit 3, input register 200: no answer") for fault in silent)
    lost_s = sum(fault.count for fault in silent) * TIMEOUT_S
    assert len(silent) >= 2 and lost_s < 0.05 * seconds  # it is asked less and less often
    for column, whole in zip([0, 1, 3, 4, 5, 6, 7], range(7), strict=True):
        share = len(_samples(items, column)) / len(_samples(without, whole))
        assert share > 1 - lost_s / seconds - FAIR


def test_a_unit_that_comes_back_is_read_again():
    units, present = [_unit(1), _unit(2)], _unit(1)

    class _Later:
        sent = 0

        def __init__(self) -> None:
            self._one = daq.gauges.device([present], lambda now_ns: [0.5])
            self._both = daq.gauges.device(units, lambda now_ns: [0.5, 0.6])
            self.connected = self._both.connected
            self.tick = self._both.tick

        def received(self, data: bytes, now_ns: int):
            return (self._both if now_ns > 10 * S else self._one).received(data, now_ns)

    items = SimulatedLine(LINE.character_ns).run(daq.gauges.host(units), _Later(), 20 * S)
    back = _samples(items, 1)
    assert 10 * S < back[0].last_byte_ns < 16 * S
    assert len(back) > 0.4 * len([s for s in _samples(items, 0) if s.last_byte_ns > back[0].last_byte_ns])


def test_slow_rate_leaves_time_to_the_others():
    units = [_unit(1, rate_hz=10), _unit(2), _unit(3)]
    items = _simulated(daq.gauges.host(units), units, 10)
    slow, *quick = (len(_samples(items, column)) for column in range(3))
    assert 95 <= slow <= 101 and min(quick) > 5 * slow and max(quick) - min(quick) <= 0.05 * max(quick)


@pytest.mark.parametrize(
    "units", [[_unit(1), _unit(2)], [_unit(1), _unit(1, address=202, value=VALUE | {"address": 202})]]
)
def test_a_late_answer_is_never_credited_to_another_gauge_or_request(units):
    dice = random.Random(11)
    taken: list[list[int]] = [[], []]

    def numbered(now_ns: int) -> list[float]:
        for times in taken:
            times.append(now_ns)
        return [(len(taken[0]) - 1) * 0.25, (len(taken[0]) - 1) * -0.25]

    line = SimulatedLine(LINE.character_ns, delay_ns=lambda: dice.randrange(round(1.9 * TIMEOUT_S * S)))
    items = line.run(daq.gauges.host(units), daq.gauges.device(units, numbered), 200 * S)
    assert len(samples_of(items)) > 300
    for column, sign in ((0, 1), (1, -1)):
        for sample in _samples(items, column):
            number = sample.values[column] / 0.25 * sign
            assert number >= 0 and sample.requested_ns <= taken[column][round(number)] <= sample.first_byte_ns
    assert {item.kind for item in faults_of(items)} == {FaultKind.SILENT, FaultKind.LATE}


# --- what is named ---


def _rtu(*content: int) -> bytes:
    frame = bytes(content)
    return frame + FramerRTU.compute_CRC(frame).to_bytes(2, "big")


@pytest.mark.parametrize("alone", [True, False])
def test_another_master_is_named(alone):
    units = [_unit(1)] if alone else [_unit(1), _unit(2)]
    asks, answers = _rtu(2, 3, 0, 16, 0, 4), _rtu(2, 3, 8, *range(8))
    other = [(k * S // 7 + at, data) for k in range(7, 70) for at, data in ((0, asks), (3_000_000, answers))]
    items = _simulated(daq.gauges.host(units), units, 10, SimulatedLine(LINE.character_ns, other=other))
    named = _faults(items, FaultKind.STRANGER)
    assert any("unit 2" in fault.detail for fault in named)
    wanted = {0.01} if alone else {0.01, 0.02}
    read = {round(value, 6) for sample in samples_of(items) for value in sample.values if math.isfinite(value)}
    assert read == wanted


def test_a_line_that_another_master_keeps_busy_is_named():
    host = daq.gauges.host([_unit(1)])
    other = [(k * S // 50, _rtu(2, 3, 0, 16, 0, 4)) for k in range(500)]
    items = SimulatedLine(LINE.character_ns, other=other).run(
        host, daq.gauges.device([_unit(1)], lambda _: [1.0]), 10 * S
    )
    assert _faults(items, FaultKind.LATE)


@pytest.mark.parametrize("framing", ["rtu", "ascii"])
@pytest.mark.parametrize("count", [1, 2])
def test_an_adapter_that_echoes_does_no_harm(framing, count):
    units = [_unit(number, framing=framing) for number in range(1, count + 1)]
    line = SimulatedLine(LINE.character_ns, echo=True)
    items = _simulated(daq.gauges.host(units), units, 10, line)
    assert len(_samples(items, 0)) > 500 and not faults_of(items)


def test_two_probes_of_one_orbit_unit():
    probes = [
        gauge("solartron_orbit", parameter=2, status_parameter=3),
        gauge("solartron_orbit", parameter=8, status_parameter=9),
    ]
    device = daq.gauges.device(probes, lambda now_ns: [0.25, -0.75])
    items = SimulatedLine(LINE.character_ns).run(daq.gauges.host(probes), device, 10 * S)
    assert {s.values[0] for s in _samples(items, 0)} == {0.25} and {s.values[1] for s in _samples(items, 1)} == {-0.75}
    assert not faults_of(items)
    assert abs(device.sent - len(samples_of(items))) <= 4  # of each the first, and one on its way


@pytest.mark.parametrize("calls", range(8))
def test_reading_of_an_orbit_during_an_error_is_not_confirmed_by_a_status_after_it(calls):
    remaining = [calls]

    def read(now_ns: int) -> list[float]:
        remaining[0] -= 1
        return [math.nan if remaining[0] >= 0 else 0.25]

    gauges = [gauge("solartron_orbit", parameter=2, status_parameter=3)]
    items = SimulatedLine(LINE.character_ns).run(daq.gauges.host(gauges), daq.gauges.device(gauges, read), 10 * S)
    assert {sample.values[0] for sample in _samples(items, 0)} == {0.25}


# --- on a real line ---

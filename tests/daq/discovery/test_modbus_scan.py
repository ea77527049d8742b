import math
import random
import re
from dataclasses import replace
from typing import Any

import pytest
import yaml

import daq.gauges
from daq.acquisition.streams import streams_of
from daq.discovery import modbus_scan
from daq.discovery.cell_finding import CellFinding, FindingVerdict
from daq.discovery.modbus_scan import likely_decodings
from daq.emulators.simulated_cell import SimulatedLine
from daq.emulators.simulated_clock import SimulatedClock
from daq.gauge_drivers.modbus_map import registers_over_time
from rigs.load import SHIPPED, parse
from rigs.schema.links import Line
from rigs.schema.modbus import ModbusMap
from tests.support.drivers import PLAIN, modbus

TRUE: dict[str, Any] = {
    "unit": 7,
    "function": 4,
    "address": 200,
    "count": 10,
    "word_order": "little",
    "byte_order": "big",
    "value": {"address": 203, "type": "float32"},
    "line": "115200 8E1",
    "timeout_s": 0.2,
    **PLAIN,
}
FLOAT64 = {"value": {"address": 203, "type": "float64"}}
COUNTS = {"value": {"address": 203, "type": "int32", "scale": 1e-4}}

# what is true of the gauge beside TRUE, what the rig file says of it, and what the doctor must say
WRONG: list[tuple[str, dict[str, Any], dict[str, Any], str]] = [
    ("unit", {}, {"unit": 1}, "write unit: 7"),
    ("words", {}, {"word_order": "big"}, "write word_order: little"),
    ("bytes", {"byte_order": "little"}, {}, "write byte_order: little"),
    ("address", {}, {"value": {"address": 204, "type": "float32"}}, "write value.address: 203"),
    ("function", COUNTS, COUNTS | {"function": 3}, "write function: 4"),
    (
        "several",
        FLOAT64 | {"byte_order": "little"},
        FLOAT64 | {"word_order": "big", "unit": 2},
        "write unit: 7, word_order: little, byte_order: little",
    ),
]


def _moved_mm(now_ns: int) -> float:
    """A probe that a hand moves to and fro, once in 1.3 s: 0.8 to 4.2 mm."""
    return 2.5 + 1.7 * math.sin(2 * math.pi * now_ns / 1.3e9)


def _gauge(fields: dict[str, Any]) -> ModbusMap:
    return modbus(**(TRUE | fields))


def _scanned(said: dict[str, Any], true: dict[str, Any] | None = None, *, network: bool = False) -> CellFinding:
    """What the doctor finds of a gauge that is moved, in simulated time. true: of it, beside TRUE."""
    port = "tcp://127.0.0.1:502" if network else "/dev/ttyUSB0"
    gauge = _gauge(true or {}).model_copy(update={"port": port})
    data = yaml.safe_load((SHIPPED / "ur10e-cell.yaml").read_text())
    fields = _gauge(said).model_dump(mode="json", exclude_none=True) | {"port": port}
    data["gauges"] = {"g1": fields}
    data["tests"] = {}
    described = streams_of(parse(yaml.safe_dump(data), "cell"))[0]
    told: list[str] = []

    def device() -> daq.gauges.Device:
        return daq.gauges.device([gauge], lambda now_ns: [_moved_mm(now_ns)])

    with SimulatedClock(1).running() as time:
        line = SimulatedLine("g1", 0 if network else gauge.line.character_ns)
        line.serve(device, [])

        def opened(name: str, port: str, setting: Line, **_: object) -> Any:
            line.change = (lambda data: (data, 0)) if network or setting == gauge.line else (lambda data: (b"", 0))
            return line.open()

        finding = modbus_scan.scan_gauge("g1", _gauge(said), replace(described, opening=opened), told.append)
        assert not time.errors
    assert "all unit addresses" in told[0] and all("move the probe" in line for line in told[1:])
    return finding


@pytest.fixture(autouse=True)
def _quick(monkeypatch):
    """Units up to 20, answers at once: the emulated gauge is on this computer."""
    monkeypatch.setattr(modbus_scan, "UNITS", range(1, 21))
    monkeypatch.setattr(modbus_scan, "SWEEP_S", 0.04)
    monkeypatch.setattr(modbus_scan, "PASS_S", 0.06)


@pytest.mark.parametrize(("true", "said", "remedy"), [case[1:] for case in WRONG], ids=[case[0] for case in WRONG])
def test_a_gauge_that_is_described_wrongly_is_found(true, said, remedy):
    finding = _scanned(said, true)
    assert (finding.verdict, finding.remedy) == (FindingVerdict.WRONG, remedy), finding
    lowest_mm, highest_mm = map(float, re.findall(r"-?\d+\.\d{4}", finding.what)[:2])
    assert 0.79 < lowest_mm < 1.5 and 3.5 < highest_mm < 4.25  # the motion is shown


def test_a_gauge_behind_a_gateway():
    finding = _scanned({"unit": 1, "word_order": "big"}, network=True)
    assert finding.remedy == "write unit: 7, word_order: little", finding


def test_a_gauge_at_another_line_setting(monkeypatch):
    monkeypatch.setattr(modbus_scan, "UNITS", range(1, 3))
    lines = tuple(map(Line.model_validate, ("9600 8N1", "115200 8E1")))
    monkeypatch.setattr(modbus_scan, "USUAL_LINES", lines)
    finding = _scanned({"line": "19200 8E1", "byte_order": "little"})
    assert finding.remedy == "write line: 115200 8E1, byte_order: big", finding


def test_a_gauge_that_is_described_rightly():
    assert _scanned({}).verdict is FindingVerdict.OK


# --- judged without a line ---


def _seen(readings: list[list[int]]) -> dict[tuple[tuple[int, int], tuple[int, int]], dict[int, list[int]]]:
    return {((7, 4), (200, 10)): {200 + k: [registers[k] for registers in readings] for k in range(10)}}


def _held(gauge: ModbusMap, path_mm: list[float]) -> list[list[int]]:
    found = [registers_over_time(gauge, lambda _, mm=mm: [mm])(0) for mm in path_mm]
    assert all(found)
    return found


def test_unmoved_probe_is_not_found():
    assert likely_decodings(_gauge({}), _seen(_held(_gauge({}), [2.5] * 40))) == []


def test_numbers_at_random_are_no_motion():

    dice = random.Random(4)
    readings = [[dice.randrange(65536) for _ in range(10)] for _ in range(40)]
    assert likely_decodings(_gauge({"value": {"address": 203, "type": "int16", "scale": 0.001}}), _seen(readings)) == []


def test_readings_out_of_the_stated_range_are_none():
    path_mm = [_moved_mm(k * 100_000_000) for k in range(40)]
    assert likely_decodings(_gauge({"range_mm": (-1, 1)}), _seen(_held(_gauge({}), path_mm))) == []

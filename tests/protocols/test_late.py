"""An answer is never credited to a later request, however late it comes: thousands of requests in simulated time."""

from __future__ import annotations

import random
from collections import Counter

import pytest
from drivers import TCP, gauge, keyence, modbus, sylvac
from simulated import S, simulate

import daq.gauges
from daq.protocol.conversation import Fault, FaultKind, Sample
from daq.protocol.polled import Polled
from rigs.gauges import Gauge

TIMEOUT_S = 0.05
SLOWEST_S = 1.9 * TIMEOUT_S
CASES = {
    "rtu": modbus(timeout_s=TIMEOUT_S),
    "tcp": modbus(timeout_s=TIMEOUT_S, port=TCP),
    "sylvac": sylvac(timeout_s=TIMEOUT_S),
    "keyence": keyence(timeout_s=TIMEOUT_S),
    "ascii": modbus(timeout_s=TIMEOUT_S, framing="ascii"),
    "c1202": gauge("mahr_c1202", timeout_s=TIMEOUT_S),
    "orbit": gauge("solartron_orbit", timeout_s=TIMEOUT_S),
}


def _run(gauge: Gauge, requests: int) -> tuple[list[Sample], Counter[FaultKind], list[int]]:
    """Samples, faults, and when the n-th reading (n µm) was taken, which is when it was asked for."""
    taken_ns: list[int] = []
    generator = random.Random(7)

    def read(now_ns: int) -> list[float]:
        taken_ns.append(now_ns)
        return [(len(taken_ns) - 1) * 1e-3]

    host, device = daq.gauges.host([gauge]), daq.gauges.device([gauge], read)
    until_ns = round(requests * SLOWEST_S * S)
    items = simulate(host, device, until_ns, delay_ns=lambda: generator.randrange(round(SLOWEST_S * S)))
    faults = Counter[FaultKind]()
    for item in items:
        if isinstance(item, Fault):
            faults[item.kind] += item.count
    return [item for item in items if isinstance(item, Sample)], faults, taken_ns


def _strangers(samples: list[Sample], taken_ns: list[int]) -> int:
    return sum(taken_ns[round(sample.values[0] * 1e3)] != sample.requested_ns for sample in samples)


@pytest.mark.parametrize("name", CASES)
def test_each_value_belongs_to_its_own_request(name: str) -> None:
    samples, faults, taken_ns = _run(CASES[name], 10_000)
    assert len(taken_ns) >= 10_000
    assert _strangers(samples, taken_ns) == 0
    requests_a_sample = 2 if name == "orbit" else 1
    assert len(samples) > 3000 / requests_a_sample**2 and faults[FaultKind.SILENT] > 3000
    assert set(faults) == {FaultKind.SILENT, FaultKind.LATE}
    assert abs(faults[FaultKind.SILENT] - faults[FaultKind.LATE]) <= 1, "every late answer was told"


@pytest.mark.parametrize("name", ["rtu", "ascii", "sylvac", "keyence", "c1202", "orbit"])
def test_without_the_drain_answers_are_one_behind(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Polled, "_give_up", lambda self, items, now_ns: self._ask(items, now_ns))
    samples, _, taken_ns = _run(CASES[name], 500)
    assert _strangers(samples, taken_ns) > 50

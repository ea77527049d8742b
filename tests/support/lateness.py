"""Instruments with random answer delays around the time-out. Each reading identifies the request it answers."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import daq.gauges
from daq.acquisition.stream_buffer import faults_of, samples_of
from daq.protocol.conversation import Fault, FaultKind, Sample
from daq.protocol.polled import Polled
from rigs.schema.gauges import Gauge
from tests.support.drivers import GAUGES
from tests.support.simulated_conversation import S, simulate

TIMEOUT_S = 0.05
SLOWEST = 1.9
"""Longest answer delay in multiples of the time-out. Up to 2, no late answer may be credited to another request."""
STEP_MM = 0.02
"""A step that every display can show in its coarsest unit."""


@dataclass(frozen=True)
class Late:
    """Result of a series of requests. `shifted`: number of answers credited to the wrong request."""

    requests: int
    samples: int
    shifted: int
    faults: Counter[FaultKind]

    def __str__(self) -> str:
        told = ", ".join(f"{self.faults[kind]} {kind}" for kind in sorted(self.faults))
        return f"{self.requests} requests, {self.samples} answered in time, {told}; {self.shifted} shifted"


class Numbered:
    """An instrument whose n-th reading is n steps. It stores the time of each reading."""

    def __init__(self) -> None:
        self.taken_ns: list[int] = []

    def read(self, now_ns: int) -> list[float]:
        self.taken_ns.append(now_ns)
        return [(len(self.taken_ns) - 1) * STEP_MM]

    def took_ns(self, sample: Sample) -> int:
        """Time at which the reading of a sample was taken."""
        return self.taken_ns[round(sample.values[0] / STEP_MM)]


def polled() -> dict[str, Gauge]:
    """A gauge of each polled kind, in mm, by the name of its interface."""
    kinds = {name: gauges[0] for name, gauges, _ in GAUGES if len(gauges) == 1 and gauges[0].units == "mm"}
    quick = {name: type(gauge).model_validate({**dict(gauge), "timeout_s": TIMEOUT_S}) for name, gauge in kinds.items()}
    return {name: gauge for name, gauge in quick.items() if isinstance(daq.gauges.host([gauge]), Polled)}


def simulated(gauge: Gauge, requests: int, seed: int, slowest: float = SLOWEST) -> Late:
    """Run at least `requests` requests in simulated time. Readings are taken at the time of the request."""
    instrument, dice = Numbered(), random.Random(seed)
    slowest_ns = round(slowest * TIMEOUT_S * S)
    device = daq.gauges.device([gauge], instrument.read)
    until_ns = requests * max(slowest_ns, S // 20)
    items = simulate(daq.gauges.host([gauge]), device, until_ns, delay_ns=lambda: dice.randrange(slowest_ns))
    samples = samples_of(items)
    shifted = sum(instrument.took_ns(sample) != sample.requested_ns for sample in samples)
    return Late(len(instrument.taken_ns), len(samples), shifted, _counted(faults_of(items)))


def _counted(faults: Sequence[Fault]) -> Counter[FaultKind]:
    counts = Counter[FaultKind]()
    for fault in faults:
        counts[fault.kind] += fault.count
    return counts

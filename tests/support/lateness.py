"""Instruments with random answer delays around the time-out. Each reading identifies the request it answers.

Thousands of requests run in simulated time, and some over a real pty through the reader of the daemon.
"""

from __future__ import annotations

import random
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from threading import Event, Thread

import daq.gauges
from daq.acquisition.reader import StreamReader
from daq.acquisition.stream_buffer import StreamBuffer, faults_of, samples_of
from daq.acquisition.streams import Stream
from daq.apps.emulate.pty_line import PtyLine
from daq.protocol.conversation import ConversationStep, Device, Fault, FaultKind, Item, Sample
from daq.protocol.polled import Polled
from daq.wire.conversation_loop import run_conversation
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

    def __init__(self, heads: int = 1) -> None:
        self.taken_ns: list[int] = []
        self._heads = heads

    def read(self, now_ns: int) -> list[float]:
        self.taken_ns.append(now_ns)
        return [(len(self.taken_ns) - 1) * STEP_MM] * self._heads

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


def wired(gauge: Gauge, requests: int, seed: int) -> Late:
    """Run requests over a pty through the reader of the daemon. Each reading must be taken between its request and
    its answer.
    """
    instrument, dice, stop = Numbered(), random.Random(seed), Event()
    line = PtyLine.open(gauge.line)
    device = _Dawdling(daq.gauges.device([gauge], instrument.read), dice)
    stream = Stream("g1", ("g1_mm",), line.port, gauge.line, partial(daq.gauges.host, [gauge]))
    buffer, items = StreamBuffer(stream.name, stream.columns), list[Item]()
    serve = Thread(target=run_conversation, args=(line, device, lambda _: None, stop.is_set))
    reader = StreamReader(stream, buffer, stream.open())
    serve.start()
    reader.start()
    try:
        while len(instrument.taken_ns) < requests:
            time.sleep(0.05)
            items += buffer.drain()
    finally:
        reader.stop()
        reader.join()
        stop.set()
        serve.join()
        line.close()
    samples = samples_of([*items, *buffer.drain()])
    shifted = sum(not sample.requested_ns <= instrument.took_ns(sample) <= sample.first_byte_ns for sample in samples)
    return Late(len(instrument.taken_ns), len(samples), shifted, _counted(faults_of(items)))


class _Dawdling:
    """A device that delays each answer by a random time. Answers keep their order."""

    def __init__(self, device: Device, dice: random.Random) -> None:
        self._device, self._dice = device, dice
        self._waiting: list[tuple[int, bytes]] = []

    def connected(self, now_ns: int) -> ConversationStep:
        return self._keep(self._device.connected(now_ns), now_ns)

    def received(self, data: bytes, now_ns: int) -> ConversationStep:
        return self._keep(self._device.received(data, now_ns), now_ns)

    def tick(self, now_ns: int) -> ConversationStep:
        return self._keep(ConversationStep(), now_ns)

    def _keep(self, step: ConversationStep, now_ns: int) -> ConversationStep:
        if step.send:
            free_ns = max(self._waiting[-1][0] if self._waiting else 0, now_ns)
            delay_ns = self._dice.randrange(round(SLOWEST * TIMEOUT_S * S))
            self._waiting.append((free_ns + delay_ns, step.send))
        due = b"".join(answer for at_ns, answer in self._waiting if at_ns <= now_ns)
        self._waiting = [(at_ns, answer) for at_ns, answer in self._waiting if at_ns > now_ns]
        return ConversationStep(due, wake_ns=self._waiting[0][0] if self._waiting else None)


def _counted(faults: Sequence[Fault]) -> Counter[FaultKind]:
    counts = Counter[FaultKind]()
    for fault in faults:
        counts[fault.kind] += fault.count
    return counts

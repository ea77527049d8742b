"""Instruments that count what they latched, and when: the truth that aligned times are held against."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from virtual_line import Wire, run

from daq import feedback, gauges
from daq.emulators.own_clock import OwnClock
from daq.protocol.conversation import Item, Sample
from rigs.feedback import Feedback
from rigs.gauges import Gauge

Array = np.ndarray[Any, Any]
GAUGE_STEP_MM = 1e-3
JOINT_STEP_DEG = 1e-3
US, MS, S = 1_000, 1_000_000, 1_000_000_000


@dataclass
class Latched:
    """What an instrument read, and when: a reading is its own number, so a recorded value tells its true time."""

    step: float
    width: int
    at_ns: list[int] = field(default_factory=list)

    def __call__(self, now_ns: int) -> Sequence[float]:
        self.at_ns.append(now_ns)
        return [len(self.at_ns) * self.step] * self.width

    def truth_ns(self, values: Array) -> Array:
        """When the readings (n,) were latched, (n,) ns."""
        return np.asarray(self.at_ns, dtype=np.int64)[np.round(values / self.step).astype(int) - 1]


@dataclass(frozen=True)
class Stamped:
    """Columns as a run stores them, and the true times (n,) ns."""

    columns: dict[str, Array]
    truth_ns: Array


def gauge_run(gauge: Gauge, wire: Wire, seconds: float, ppm: float = 0.0) -> Stamped:
    """A gauge read for so long in simulated time; ppm: its own clock's."""
    latched = Latched(GAUGE_STEP_MM, 1)
    device = OwnClock(lambda read: gauges.device([gauge], read), latched, ppm)
    return _stamped(run(gauges.host([gauge]), device, wire, round(seconds * S)), latched)


def robot_run(robot: Feedback, wire: Wire, seconds: float, ppm: float) -> Stamped:
    """A controller listened to for so long in simulated time; ppm: its own clock's."""
    latched = Latched(JOINT_STEP_DEG, 6)
    device = OwnClock(lambda read: feedback.device(robot, read), latched, ppm)
    return _stamped(run(feedback.host(robot), device, wire, round(seconds * S)), latched)


def _stamped(items: Sequence[Item], latched: Latched) -> Stamped:
    samples = [item for item in items if isinstance(item, Sample)]
    names = ("requested_ns", "first_byte_ns", "last_byte_ns", "size", "device_time_s")
    columns = {name: np.array([getattr(sample, name) for sample in samples]) for name in names}
    return Stamped(columns, latched.truth_ns(np.array([sample.values[0] for sample in samples])))


def serial(
    rng: np.random.Generator, character_ns: int, latency_ms: float, answer_ms: float = 3.0, slow: float = 1.003
) -> Wire:
    """A serial line as it may be: the instrument's baud off by 0.3 %, its answer begun within `answer_ms`, the reading
    latched anywhere before, the host late by some 0.1 ms."""
    thinking: list[float] = []

    def latch_ns() -> int:
        thinking.append(float(rng.uniform(0, answer_ms * 1e6)))
        return round(float(rng.uniform(0, thinking[-1])))

    return Wire(
        round(character_ns * slow),
        latency_ms,
        latch_ns,
        lambda: round(thinking.pop()),
        lambda: round(float(rng.exponential(0.1e6))),
    )


def network(rng: np.random.Generator, jitter_ms: float) -> Wire:
    """A network whose packets are late by so much on average; 0.2 ms at least."""
    return Wire(late_ns=lambda: round(200_000 + float(rng.exponential(jitter_ms * 1e6))))

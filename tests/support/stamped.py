"""Instruments that number their readings and store the latching times, the truth for aligned timestamps."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from daq import feedback, gauges
from daq.emulators.timed import STEADY, OwnClock, Unsteady, timed_device, timed_read
from daq.protocol.conversation import Item, Sample
from rigs.schema.feedback import Feedback
from rigs.schema.gauges import Gauge
from tests.support.virtual_line import Wire, run

Array = np.ndarray[Any, Any]
GAUGE_STEP_MM = 1e-3
JOINT_STEP_DEG = 1e-3
MOVES = 7
_RESTING = 20
US, MS, S = 1_000, 1_000_000, 1_000_000_000


@dataclass
class Latched:
    """Readings of an instrument and their times. Each reading is unique, so a recorded value identifies its true time.

    moves: step between readings in units of the resolution. The first readings differ by one unit, as of a gauge at
    rest.
    """

    step: float
    width: int
    moves: int = 1
    at_ns: list[int] = field(default_factory=list)

    def __call__(self, now_ns: int) -> Sequence[float]:
        self.at_ns.append(now_ns)
        return [self._number(len(self.at_ns)) * self.step] * self.width

    def truth_ns(self, values: Array) -> Array:
        """Latching times (n,) ns of readings (n,); for a mean of several, the middle time."""
        numbers = [self._number(count) for count in range(1, len(self.at_ns) + 1)]
        place = np.searchsorted(numbers, np.round(values / self.step).astype(int))
        return np.asarray(self.at_ns, dtype=np.int64)[place]

    def _number(self, count: int) -> int:
        return count + (self.moves - 1) * max(0, count - _RESTING)


@dataclass(frozen=True)
class Stamped:
    """Columns as stored in a run, and the true times (n,) ns."""

    columns: dict[str, Array]
    truth_ns: Array


def gauge_run(
    gauge: Gauge, wire: Wire, seconds: float, ppm: float = 0.0, unsteady: Unsteady = STEADY, seed: int = 1
) -> Stamped:
    """Read a gauge in simulated time. ppm: error of the gauge clock; unsteady: variation of the internal cycle."""
    moves = MOVES if gauge.timing.latch == "own_cycle" else 1
    latched, chance = Latched(GAUGE_STEP_MM, 1, moves), random.Random(seed)
    shown = timed_read(latched, gauge.timing, unsteady, chance)
    device = OwnClock(lambda read: gauges.device([gauge], read), shown, ppm)
    timed = timed_device(device, gauge.timing, unsteady, chance)
    return _stamped(run(gauges.host([gauge]), timed, wire, round(seconds * S)), latched)


def robot_run(robot: Feedback, wire: Wire, seconds: float, ppm: float) -> Stamped:
    """Receive from a controller in simulated time. ppm: error of the controller clock."""
    latched = Latched(JOINT_STEP_DEG, 6)
    device = OwnClock(lambda read: feedback.device(robot, read), latched, ppm)
    return _stamped(run(feedback.host(robot), device, wire, round(seconds * S)), latched)


def _stamped(items: Sequence[Item], latched: Latched) -> Stamped:
    samples = [item for item in items if isinstance(item, Sample)]
    names = ("requested_ns", "first_byte_ns", "last_byte_ns", "size", "device_time_s")
    columns = {name: np.array([getattr(sample, name) for sample in samples]) for name in names}
    columns["g1_mm"] = np.array([sample.values[0] for sample in samples])
    return Stamped(columns, latched.truth_ns(columns["g1_mm"]))


def serial(
    rng: np.random.Generator,
    character_ns: int,
    latency_ms: float,
    answer_ms: float = 3.0,
    latched_ms: float | None = None,
) -> Wire:
    """A realistic serial line.

    The baud rate of the instrument is 0.3 % low, the answer starts within `answer_ms`, the reading is latched at a
    random time before or within `latched_ms`, and the host is about 0.1 ms late.
    """
    thinking: list[float] = []

    def latch_ns() -> int:
        thinking.append(float(rng.uniform(0, answer_ms * 1e6)))
        return round(float(rng.uniform(0, thinking[-1] if latched_ms is None else latched_ms * 1e6)))

    return Wire(
        round(character_ns * 1.003),
        latency_ms,
        latch_ns,
        lambda: round(thinking.pop()),
        lambda: round(float(rng.exponential(0.1e6))),
    )


def network(rng: np.random.Generator, jitter_ms: float) -> Wire:
    """A network with an average packet delay of `jitter_ms`, at least 0.2 ms."""
    return Wire(late_ns=lambda: round(200_000 + float(rng.exponential(jitter_ms * 1e6))))

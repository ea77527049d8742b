"""Watching the clocks: the computer's wall clock that is set, its sleep, a computer that holds rigd up, and how an
instrument's own clock runs against the host's.

Everything is stamped by the monotonic clock, which neither touches. What does change is what time of day a stamp stands
for. NTP slews both clocks alike, so wall less monotonic is constant until someone steps the wall clock; the clock that
goes on while the computer sleeps (CLOCK_BOOTTIME) less monotonic grows by each sleep, and by nothing else.

A thread that only sleeps shows whether rigd itself runs: it reports when it slept for too long. A computer that is
suspended for a moment, that starves its programs, or a process that is stopped holds up every reader at once. Readers
report their own stalls (`StreamBuffer.beat`); this one says that it was not a single reader.

An instrument's clock is watched for metrics only. A message can only come late, so the least (host - device) difference
of each ten seconds is close to the clocks' true one, and a line through these minima shows the drift. Runs keep raw
stamps and are fitted again at analysis.
"""

from __future__ import annotations

import math
import statistics
import threading
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np

from daq import clock
from daq.acquisition.stream_buffer import STALL_NS
from daq.protocol.conversation import Fault, FaultKind, Sample, Samples

HOST = "host"
"""The name under which faults of the computer itself are reported, in place of a stream's."""
_STEP_NS = 10_000_000
_TRIES = 10


@dataclass(frozen=True)
class ClockReadings:
    """The three clocks, ns: true of one instant to within bracket_ns. boot_ns goes on while the computer sleeps."""

    monotonic_ns: int
    wall_ns: int
    boot_ns: int
    bracket_ns: int = 0


def read_clocks() -> ClockReadings:
    """Read the three clocks now: of several tries the one that the scheduler interrupted least."""
    tries = []
    for _ in range(_TRIES):
        before = clock.now_ns()
        wall_ns, boot_ns = clock.wall_ns(), clock.boot_ns()
        after = clock.now_ns()
        tries.append(ClockReadings((before + after) // 2, wall_ns, boot_ns, after - before))
    return min(tries, key=lambda tried: tried.bracket_ns)


class HostClockMonitor:
    """Compares each reading of the clocks with the last one that showed a change."""

    def __init__(self, first: ClockReadings) -> None:
        self._known = first

    def check(self, now: ClockReadings) -> list[Fault]:
        """Return what has happened to the clocks since then, as faults."""
        last = self._known
        slept_ns = (now.boot_ns - last.boot_ns) - (now.monotonic_ns - last.monotonic_ns)
        set_ns = (now.wall_ns - last.wall_ns) - (now.boot_ns - last.boot_ns)
        details = []
        if slept_ns > _STEP_NS:
            details.append(f"the computer slept for {slept_ns / 1e9:.1f} s and read nothing; switch its suspend off")
        if abs(set_ns) > _STEP_NS:
            earlier, after = (
                datetime.fromtimestamp(wall_ns // 10**6 / 1e3, UTC).isoformat(timespec="milliseconds")
                for wall_ns in (now.wall_ns - set_ns, now.wall_ns)
            )
            details.append(f"the wall clock was set by {set_ns / 1e9:+.3f} s, from {earlier} to {after}")
        if details:
            self._known = now
        return [Fault(FaultKind.CLOCK, now.monotonic_ns, detail) for detail in details]


_SLEEP_S = 0.1


class StallWatch(clock.Thread):
    """Sleeps until `stop`, and keeps a fault for each time it was asleep for longer than `longest_ns`."""

    def __init__(self, longest_ns: int = STALL_NS) -> None:
        super().__init__(name="stalls", daemon=True)
        self._longest_ns = longest_ns
        self._stop_asked = clock.Event()
        self._faults: deque[Fault] = deque()
        self._lock = threading.Lock()
        """Held while this thread, or the one that takes, says that it is awake: a stall is a fault once."""
        self._awake_ns = 0

    def start(self) -> None:
        """Begin to sleep."""
        self._awake_ns = clock.now_ns()
        super().start()

    def run(self) -> None:
        """Do the work until `stop`: the body of the thread."""
        while not self._stop_asked.wait(_SLEEP_S):
            self._awake()

    def _awake(self) -> None:
        with self._lock:
            before_ns, self._awake_ns = self._awake_ns, clock.now_ns()
            self.note(before_ns, self._awake_ns)

    def note(self, before_ns: int, now_ns: int) -> None:
        """Keep a fault if the thread was asleep for too long between these times."""
        if now_ns - before_ns > self._longest_ns:
            detail = f"rigd or the computer stood still for {(now_ns - before_ns) / 1e9:.1f} s"
            self._faults.append(Fault(FaultKind.STALLED, now_ns, f"{detail}; what came meanwhile is stamped late"))

    def take(self) -> list[Fault]:
        """Return the faults since the last call, that of a sleep which has just ended among them."""
        if self.is_alive():
            self._awake()
        return [self._faults.popleft() for _ in range(len(self._faults))]

    def stop(self) -> None:
        """Ask the thread to end."""
        self._stop_asked.set()


_WINDOW_S = 10.0
_WINDOWS = 60
_LEAP_S = 1.0
"""A difference that leaps by more is a clock that was set or started again."""


@dataclass(frozen=True)
class ClockState:
    """offset_s: host's monotonic less device, the latest minimum. drift_ppm: how much faster the host's runs; None
    until there are three windows. late_s: the most that a sample of the last window came after its earliest peers."""

    offset_s: float
    drift_ppm: float | None
    late_s: float


class DriftMonitor:
    """Follows an instrument's clock by the minima of the last ten minutes."""

    def __init__(self) -> None:
        self._minima: deque[tuple[float, float]] = deque(maxlen=_WINDOWS)
        self._begun_s = math.nan
        self._least = self._most = math.nan
        self._late_s = math.nan

    def feed(self, samples: Sequence[Sample]) -> None:
        """Take samples in order of arrival; those without a time of their own are ignored."""
        block = Samples.of(samples)
        timed = block.chosen(~np.isnan(block.device_time_s))
        hosts_s = timed.first_byte_ns / 1e9
        for host_s, offset_s in zip(hosts_s.tolist(), (hosts_s - timed.device_time_s).tolist(), strict=True):
            if abs(offset_s - self._least) > _LEAP_S:
                self._minima.clear()
                self._begun_s = math.nan
            if host_s - self._begun_s >= _WINDOW_S:
                self._minima.append((self._begun_s + _WINDOW_S / 2, self._least))
                self._late_s = self._most - self._least
                self._begun_s = math.nan
            if math.isnan(self._begun_s):
                self._begun_s, self._least, self._most = host_s, offset_s, offset_s
            self._least, self._most = min(self._least, offset_s), max(self._most, offset_s)

    def state(self) -> ClockState | None:
        """Return the state as of the last complete window; None before there is one."""
        if not self._minima:
            return None
        drift_ppm = None
        if len(self._minima) >= 3:  # two make a line of any two readings
            drift_ppm = 1e6 * statistics.linear_regression(*zip(*self._minima, strict=True)).slope
        return ClockState(self._minima[-1][1], drift_ppm, self._late_s)

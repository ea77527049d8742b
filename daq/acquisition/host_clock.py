"""Monitoring of clocks: steps of the wall clock, suspends, stalls of rigd, and the drift of instrument clocks.

None of these events affect the monotonic clock of the timestamps. NTP slews both clocks together, so the difference
between wall and monotonic time changes only by a step; that between CLOCK_BOOTTIME and monotonic time by each suspend.
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
from daq.protocol.conversation import Fault, FaultKind, Sample, SampleBlock

HOST = "host"
"""Stream name for faults of the computer itself."""
_STEP_NS = 10_000_000
_TRIES = 10


@dataclass(frozen=True)
class ClockReadings:
    """Readings of three clocks in ns, taken within bracket_ns. boot_ns includes suspends."""

    monotonic_ns: int
    wall_ns: int
    boot_ns: int
    bracket_ns: int = 0


def read_clocks() -> ClockReadings:
    """Clock readings taken within the shortest of several intervals."""
    tries = []
    for _ in range(_TRIES):
        before = clock.now_ns()
        wall_ns, boot_ns = clock.wall_ns(), clock.boot_ns()
        after = clock.now_ns()
        tries.append(ClockReadings((before + after) // 2, wall_ns, boot_ns, after - before))
    return min(tries, key=lambda tried: tried.bracket_ns)


class HostClockMonitor:
    """Compares the clocks with the last readings that showed a change."""

    def __init__(self, first: ClockReadings) -> None:
        self._known = first

    def check(self, now: ClockReadings) -> list[Fault]:
        last = self._known
        slept_ns = (now.boot_ns - last.boot_ns) - (now.monotonic_ns - last.monotonic_ns)
        set_ns = (now.wall_ns - last.wall_ns) - (now.boot_ns - last.boot_ns)
        details = []
        if slept_ns > _STEP_NS:
            details.append(f"the computer was suspended for {slept_ns / 1e9:.1f} s and read nothing; disable suspend")
        if abs(set_ns) > _STEP_NS:
            earlier, after = (
                datetime.fromtimestamp(wall_ns // 10**6 / 1e3, UTC).isoformat(timespec="milliseconds")
                for wall_ns in (now.wall_ns - set_ns, now.wall_ns)
            )
            details.append(f"the wall clock was set by {set_ns / 1e9:+z.3f} s, from {earlier} to {after}")
        if details:
            self._known = now
        return [Fault(FaultKind.CLOCK, now.monotonic_ns, detail) for detail in details]


_SLEEP_S = 0.1


class StallWatch(clock.StoppableThread):
    """Thread that sleeps until `stop`, and records a fault for each sleep longer than `longest_ns`."""

    def __init__(self, longest_ns: int = STALL_NS) -> None:
        super().__init__("stalls")
        self._longest_ns = longest_ns
        self._faults: deque[Fault] = deque()
        self._lock = threading.Lock()
        """Protects the wake-up time, so that a stall is recorded only once."""
        self._awake_ns = 0

    def start(self) -> None:
        self._awake_ns = clock.now_ns()
        super().start()

    def run(self) -> None:
        while not self._stop_asked.wait(_SLEEP_S):
            self._awake()

    def _awake(self) -> None:
        with self._lock:
            before_ns, self._awake_ns = self._awake_ns, clock.now_ns()
            self.note(before_ns, self._awake_ns)

    def note(self, before_ns: int, now_ns: int) -> None:
        if now_ns - before_ns > self._longest_ns:
            detail = f"rigd or the computer did not run for {(now_ns - before_ns) / 1e9:.1f} s"
            self._faults.append(
                Fault(FaultKind.STALLED, now_ns, f"{detail}; messages in the meantime have late timestamps")
            )

    def take(self) -> list[Fault]:
        if self.is_alive():
            self._awake()
        return [self._faults.popleft() for _ in range(len(self._faults))]


_WINDOW_S = 10.0
_WINDOWS = 60
_LEAP_S = 1.0
"""Jump of the difference beyond which the clock was set or restarted."""


@dataclass(frozen=True)
class ClockState:
    offset_s: float
    """Latest minimum of host monotonic minus device time."""
    drift_ppm: float | None
    """Rate of the host clock relative to the device clock, None before three windows."""
    late_s: float
    """Largest delay of a sample in the last window, relative to the earliest ones."""


class DriftMonitor:
    """Tracks the clock of an instrument, for metrics only, by the minima of the last ten minutes.

    A message can only be late, so the smallest difference (host − device) within ten seconds is close to the true
    offset. A line through these minima gives the drift.
    """

    def __init__(self) -> None:
        self._minima: deque[tuple[float, float]] = deque(maxlen=_WINDOWS)
        self._begun_s = math.nan
        self._least = self._most = math.nan
        self._late_s = math.nan

    def feed(self, samples: Sequence[Sample]) -> None:
        """Add samples in order of arrival. Samples without device time are ignored."""
        block = SampleBlock.of(samples)
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
        if not self._minima:
            return None
        drift_ppm = None
        if len(self._minima) >= 3:  # a line through two minima has no residual
            drift_ppm = 1e6 * statistics.linear_regression(*zip(*self._minima, strict=True)).slope
        return ClockState(self._minima[-1][1], drift_ppm, self._late_s)

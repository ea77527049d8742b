"""Watch the clocks: steps of the wall clock, suspends, stalls of rigd, and the drift of instrument clocks.

All stamps use the monotonic clock, which none of these events affect. Only the mapping from stamps to wall time
changes. NTP slews both clocks together, so wall minus monotonic time is constant until somebody steps the wall clock.
The clock CLOCK_BOOTTIME minus monotonic time grows by the duration of each suspend and is otherwise constant.

A thread that only sleeps measures whether rigd runs at all: it reports each sleep of excessive length. A suspended or
overloaded computer, or a stopped process, delays all readers simultaneously. Readers report their own stalls
(`StreamBuffer.beat`); this thread shows whether all of them were affected.

The clock of an instrument is watched for metrics only. A message can only be late, so the smallest difference (host −
device) in ten seconds is close to the true offset, and a line through these minima gives the drift. Runs keep raw
stamps; the analysis fits them again.
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
"""Stream name for faults of the computer itself."""
_STEP_NS = 10_000_000
_TRIES = 10


@dataclass(frozen=True)
class ClockReadings:
    """Three clocks in ns, read within bracket_ns of each other. boot_ns includes suspends."""

    monotonic_ns: int
    wall_ns: int
    boot_ns: int
    bracket_ns: int = 0


def read_clocks() -> ClockReadings:
    """Read the three clocks; the least interrupted of several attempts is returned."""
    tries = []
    for _ in range(_TRIES):
        before = clock.now_ns()
        wall_ns, boot_ns = clock.wall_ns(), clock.boot_ns()
        after = clock.now_ns()
        tries.append(ClockReadings((before + after) // 2, wall_ns, boot_ns, after - before))
    return min(tries, key=lambda tried: tried.bracket_ns)


class HostClockMonitor:
    """Compares clock readings with the last reading that showed a change."""

    def __init__(self, first: ClockReadings) -> None:
        self._known = first

    def check(self, now: ClockReadings) -> list[Fault]:
        """Return the clock changes since the last check as faults."""
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
    """Thread that sleeps until `stop` and records a fault for each sleep longer than `longest_ns`."""

    def __init__(self, longest_ns: int = STALL_NS) -> None:
        super().__init__(name="stalls", daemon=True)
        self._longest_ns = longest_ns
        self._stop_asked = clock.Event()
        self._faults: deque[Fault] = deque()
        self._lock = threading.Lock()
        """Protects the wake-up time, so that a stall becomes one fault only."""
        self._awake_ns = 0

    def start(self) -> None:
        """Start the thread."""
        self._awake_ns = clock.now_ns()
        super().start()

    def run(self) -> None:
        """Work until `stop`."""
        while not self._stop_asked.wait(_SLEEP_S):
            self._awake()

    def _awake(self) -> None:
        with self._lock:
            before_ns, self._awake_ns = self._awake_ns, clock.now_ns()
            self.note(before_ns, self._awake_ns)

    def note(self, before_ns: int, now_ns: int) -> None:
        """Record a fault if the time between both stamps is too long."""
        if now_ns - before_ns > self._longest_ns:
            detail = f"rigd or the computer stood still for {(now_ns - before_ns) / 1e9:.1f} s"
            self._faults.append(
                Fault(FaultKind.STALLED, now_ns, f"{detail}; messages in the meantime have late timestamps")
            )

    def take(self) -> list[Fault]:
        """Return the faults since the last call, including a stall that has just ended."""
        if self.is_alive():
            self._awake()
        return [self._faults.popleft() for _ in range(len(self._faults))]

    def stop(self) -> None:
        """Request the end of the thread."""
        self._stop_asked.set()


_WINDOW_S = 10.0
_WINDOWS = 60
_LEAP_S = 1.0
"""A larger jump of the difference means a clock that was set or restarted."""


@dataclass(frozen=True)
class ClockState:
    """State of an instrument's clock.

    offset_s: host monotonic minus device time, the latest minimum. drift_ppm: how much faster the host clock runs; None
    before three windows. late_s: largest delay of a sample in the last window relative to the earliest ones.
    """

    offset_s: float
    drift_ppm: float | None
    late_s: float


class DriftMonitor:
    """Tracks the clock of an instrument by the minima of the last ten minutes."""

    def __init__(self) -> None:
        self._minima: deque[tuple[float, float]] = deque(maxlen=_WINDOWS)
        self._begun_s = math.nan
        self._least = self._most = math.nan
        self._late_s = math.nan

    def feed(self, samples: Sequence[Sample]) -> None:
        """Add samples in order of arrival, ignoring those without a device time."""
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
        """Return the state after the last complete window; None before the first one."""
        if not self._minima:
            return None
        drift_ppm = None
        if len(self._minima) >= 3:  # two minima fit a line exactly
            drift_ppm = 1e6 * statistics.linear_regression(*zip(*self._minima, strict=True)).slope
        return ClockState(self._minima[-1][1], drift_ppm, self._late_s)

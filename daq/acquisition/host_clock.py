"""Watching the computer's clocks: a wall clock that is set, and a computer that sleeps.

Everything is stamped by the monotonic clock, which neither touches. What does change is what time of day a stamp stands
for. NTP slews both clocks alike, so wall less monotonic is constant until someone steps the wall clock; the clock that
goes on while the computer sleeps (CLOCK_BOOTTIME) less monotonic grows by each sleep, and by nothing else.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime

from daq import clock
from daq.protocol.conversation import Fault, FaultKind

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
    return min((_read() for _ in range(_TRIES)), key=lambda tried: tried.bracket_ns)


def _read() -> ClockReadings:
    before = clock.now_ns()
    wall_ns, boot_ns = clock.wall_ns(), clock.boot_ns()
    after = clock.now_ns()
    return ClockReadings((before + after) // 2, wall_ns, boot_ns, after - before)


class HostClockMonitor:
    """Compares each reading of the clocks with the last one that showed a change."""

    def __init__(self, first: ClockReadings) -> None:
        self._known = first

    def check(self, now: ClockReadings) -> list[Fault]:
        """Return what has happened to the clocks since then, as faults."""
        known = self._known
        slept_ns = (now.boot_ns - known.boot_ns) - (now.monotonic_ns - known.monotonic_ns)
        set_ns = (now.wall_ns - known.wall_ns) - (now.boot_ns - known.boot_ns)
        details = []
        if slept_ns > _STEP_NS:
            details.append(f"the computer slept for {slept_ns / 1e9:.1f} s and read nothing; switch its suspend off")
        if abs(set_ns) > _STEP_NS:
            before, after = (_utc(wall_ns) for wall_ns in (now.wall_ns - set_ns, now.wall_ns))
            details.append(f"the wall clock was set by {set_ns / 1e9:+.3f} s, from {before} to {after}")
        if details:
            self._known = now
        return [Fault(FaultKind.CLOCK, now.monotonic_ns, detail) for detail in details]


def _utc(wall_ns: int) -> str:
    return datetime.fromtimestamp(wall_ns // 10**6 / 1e3, UTC).isoformat(timespec="milliseconds")

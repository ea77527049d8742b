"""The computer's clocks, read together."""

from __future__ import annotations

import time
from dataclasses import dataclass

_TRIES = 10


@dataclass(frozen=True)
class Readings:
    """The three clocks, ns: true of one instant to within bracket_ns. boot_ns goes on while the computer sleeps."""

    monotonic_ns: int
    wall_ns: int
    boot_ns: int
    bracket_ns: int = 0


def read_clocks() -> Readings:
    """Now; of some tries the one that the scheduler interrupted least."""
    return min((_read() for _ in range(_TRIES)), key=lambda tried: tried.bracket_ns)


def _read() -> Readings:
    before = time.monotonic_ns()
    wall_ns, boot_ns = time.time_ns(), time.clock_gettime_ns(time.CLOCK_BOOTTIME)
    after = time.monotonic_ns()
    return Readings((before + after) // 2, wall_ns, boot_ns, after - before)

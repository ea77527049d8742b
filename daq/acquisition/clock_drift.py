"""How an instrument's own clock runs against the host's, watched while samples come: for metrics only.

A message can only come late, so the least (host - device) difference of each ten seconds is close to the clocks' true
one, and a line through these minima shows the drift. Runs keep raw stamps and are fitted again at analysis.
"""

from __future__ import annotations

import math
import statistics
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from daq.protocol.conversation import Sample, Samples

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
        return ClockState(self._minima[-1][1], _drift_ppm(self._minima), self._late_s)


def _drift_ppm(minima: Iterable[tuple[float, float]]) -> float | None:
    """Slope of the least-squares line; None for less than three points."""
    points = list(minima)
    if len(points) < 3:
        return None
    x0, y0 = statistics.fmean(x for x, _ in points), statistics.fmean(y for _, y in points)
    rise = sum((x - x0) * (y - y0) for x, y in points)
    return 1e6 * rise / sum((x - x0) ** 2 for x, _ in points)

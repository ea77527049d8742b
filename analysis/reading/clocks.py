"""When was it measured? Host stamps, wire time and the instrument's own clock made into one time line.

A byte can only arrive late, never early. So of every bound that the stamps give, the earliest is the best;
and a line under all (host - controller) differences is the controller's clock seen through the least delay
(Olson, A Passive Solution to the Sensor Synchronization Problem, IROS 2010).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from analysis.kinematics.arm import Array
from rigs.links import Line

_LEAP_S = 1.0
"""No network or serial line holds a message back for so long without losing its link."""

Columns = Mapping[str, np.ndarray[Any, Any]]


@dataclass(frozen=True)
class Instants:
    """When each sample was taken: ns (n,) on the host's clock; u_s, the standard uncertainty that all share; restarts:
    how often the instrument's own clock began anew."""

    ns: Array
    u_s: float
    restarts: int


def gauge_instants(stream: Columns, line: Line | None) -> Instants:
    """When each reading of a gauge was taken.

    `line`: its serial settings, None over TCP. The reading was taken after the request came through and before its
    answer's first character set out. Most instruments latch late in that window, so its end is the estimate; the
    uncertainty is that of anywhere in it.
    """
    character_ns = line.character_ns if line else 0
    first, last = stream["first_byte_ns"], stream["last_byte_ns"]
    out_ns = np.minimum(first - character_ns, last - stream["size"] * character_ns).astype(float)
    asked = stream["requested_ns"]
    streaming = asked < 0
    window_ns = np.where(streaming, character_ns, out_ns - asked)
    u_s = _late_by_up_to(float(np.median(np.maximum(window_ns, 0))))
    ns, restarts = through_clock(stream["device_time_s"], out_ns)
    return Instants(ns, u_s, restarts)


def robot_instants(stream: Columns) -> Instants:
    """When each position was reported.

    A controller reports what it latched at some time in the cycle before: one cycle is what stays unknown.
    """
    ns, restarts = through_clock(stream["device_time_s"], stream["first_byte_ns"].astype(float))
    return Instants(ns, _late_by_up_to(float(np.median(np.diff(ns)))), restarts)


def _late_by_up_to(window_ns: float) -> float:
    """Standard uncertainty, in s, of the end of a window when the truth may be anywhere in it."""
    return window_ns / math.sqrt(3) / 1e9


def through_clock(device_s: Array, host_ns: Array) -> tuple[Array, int]:
    """Host times (n,) ns of an instrument's stamps by its own clock, and how often that began anew.

    The host's own where the instrument has none. A clock that goes backwards, or leaps against the host's, was
    started again or has wrapped: it is fitted in pieces.
    """
    if len(device_s) < 3 or not np.isfinite(device_s).all():
        return host_ns, 0
    ticks, passed = np.diff(device_s), np.diff(host_ns) / 1e9
    starts = np.flatnonzero((ticks < 0) | (np.abs(ticks - passed) > _LEAP_S)) + 1
    pieces = np.split(np.arange(len(device_s)), starts)
    return np.concatenate([_fitted(device_s[piece], host_ns[piece]) for piece in pieces]), len(starts)


def _fitted(device_s: Array, host_ns: Array) -> Array:
    if len(device_s) < 3 or np.ptp(device_s) == 0:
        return host_ns
    since_s = device_s - device_s[0]
    offset, rate = lower_line(since_s, (host_ns - host_ns[0]) / 1e9 - since_s)
    fitted: Array = host_ns[0] + 1e9 * (since_s + offset + rate * since_s)
    return fitted


def lower_line(x: Array, y: Array) -> tuple[float, float]:
    """Intercept and slope of the line below all points (n,) that lies closest to them on average.

    It is the edge of the lower convex hull above which the mean of x lies.
    """
    hull: list[tuple[float, float]] = []
    for point in sorted(zip(x.tolist(), y.tolist(), strict=True)):
        while len(hull) > 1 and _turns_down(hull[-2], hull[-1], point):
            hull.pop()
        hull.append(point)
    mean = float(x.mean())
    right = next(k for k in range(1, len(hull)) if hull[k][0] >= mean or k == len(hull) - 1)
    (x0, y0), (x1, y1) = hull[right - 1], hull[right]
    slope = (y1 - y0) / (x1 - x0) if x1 > x0 else 0.0
    return y0 - slope * x0, slope


def _turns_down(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> bool:
    """Whether b lies on or above the line from a to c."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) <= 0

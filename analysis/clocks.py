"""When was it measured? Host stamps, wire time and the instrument's own clock made into one time line.

A byte can only arrive late, never early. So of every bound that the stamps give, the earliest is the best;
and a line under all (host - controller) differences is the controller's clock seen through the least delay
(Olson, A Passive Solution to the Sensor Synchronization Problem, IROS 2010).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from analysis.kinematics.arm import Array
from rigs.links import Line

Columns = Mapping[str, np.ndarray[Any, Any]]


def gauge_instants(stream: Columns, line: Line | None) -> tuple[Array, float]:
    """When each reading of a gauge was taken: (n,) ns on the host's clock, and a standard uncertainty in s.

    `line`: its serial settings, None over TCP. The reading was taken after the request came through
    and before its answer's first character set out.
    """
    character_ns = line.character_ns if line else 0
    first, last = stream["first_byte_ns"], stream["last_byte_ns"]
    out_ns = np.minimum(first - character_ns, last - stream["size"] * character_ns).astype(float)
    asked = stream["requested_ns"]
    streaming = asked < 0
    window_ns = np.where(streaming, character_ns, out_ns - asked)
    u_s = float(np.median(np.maximum(window_ns, 0))) / np.sqrt(12) / 1e9
    return through_clock(stream["device_time_s"], out_ns), u_s


def robot_instants(stream: Columns) -> tuple[Array, float]:
    """When each position was reported: (n,) ns on the host's clock, and a standard uncertainty in s.

    A controller reports what it latched at some time in the cycle before: one cycle is what stays unknown.
    """
    t_ns = through_clock(stream["device_time_s"], stream["first_byte_ns"].astype(float))
    return t_ns, float(np.median(np.diff(t_ns))) / np.sqrt(12) / 1e9


def through_clock(device_s: Array, host_ns: Array) -> Array:
    """Host times (n,) ns of an instrument's stamps, by its own clock; the host's where it has none."""
    if len(device_s) < 3 or not np.isfinite(device_s).all() or np.ptp(device_s) == 0:
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

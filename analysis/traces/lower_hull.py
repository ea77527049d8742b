"""The line under points that delay can only lift: through the least delayed, whatever the others do.

A straight line over a short span; over a long one, where a clock's rate follows the temperature, a broken line of
windows joined without a step. Both are the line under all points that lies closest to them on average (Olson, A
Passive Solution to the Sensor Synchronization Problem, IROS 2010, for the straight one).
"""

from __future__ import annotations

import numpy as np

from analysis.kinematics.arm import Array
from analysis.traces.line_heights import highest_under

TICK_S = 1e-9
"""Stamps of the host count nanoseconds: what advances by less cannot be distinguished from what stands."""
WINDOW_S = 120.0
"""A crystal's rate changes by less than 0.01 ppm/s with the temperature of a hall: 18 µs over half of this."""
_BLOCK = 8
_BLOCKS = 400
_HULL_BLOCK = 64
"""Points of which at first the lowest alone is looked at."""
_NEIGHBOURS = 9
_SPREADS = 4.0
_SHORT_S = 50e-6
_FEW = 0.002
"""Points below the line of their neighbours are wrong while they are fewer than this; more of them are the line."""

Mask = np.ndarray[tuple[int], np.dtype[np.bool_]]


def floor(x: Array, y: Array, window: float = WINDOW_S) -> tuple[Array, Mask]:
    """The line (n,) under points y (n,) at increasing x (n,), both in s, and which points were too low to be true.

    At least two points. Raises nothing: where points are few none is taken for wrong.
    """
    low = low_outliers(x, y)
    under = (x[~low], y[~low]) if low.any() else (x, y)
    windows = int(np.clip((x[-1] - x[0]) // window, 1, max(1, len(x) // _BLOCK)))
    if windows == 1:
        offset, rate = lower_line(*under)
        line: Array = rate * x
        line += offset
        return line, low
    knots = np.linspace(x[0], x[-1], windows + 1)
    return np.interp(x, knots, _broken(*under, knots)), low


def low_outliers(x: Array, y: Array) -> Mask:
    """Which of y (n,) at increasing x (n,), both in s, lie alone below their neighbours' least: wrong
    stamps, not short delays.

    The least of each block of rows is compared with those around it. No more than one in 500 (or three) is ever
    taken for wrong: what recurs is a short delay.
    """
    none = np.zeros(len(x), dtype=bool)
    size = max(_BLOCK, len(x) // _BLOCKS)
    blocks = len(x) // size
    if blocks < _NEIGHBOURS:
        return none
    least = np.minimum.reduceat(y, np.arange(blocks) * size)
    at = x[np.arange(blocks) * size]
    half = blocks // 2
    apart = at[-half:] - at[:half]
    advances = apart >= TICK_S
    if not advances.any():
        return none
    slope = float(np.median((least[-half:] - least[:half])[advances] / apart[advances]))
    level = least - slope * at
    mirrored = np.pad(level, _NEIGHBOURS // 2, mode="reflect")
    around = np.median(np.lib.stride_tricks.sliding_window_view(mirrored, _NEIGHBOURS), axis=1)
    spread = float(np.quantile(np.abs(level - around), 0.95))
    level = around - _SPREADS * spread - _SHORT_S
    low = none.copy()
    # No point of a block lies below its least, less the larger of the line's two ends.
    above = least - np.maximum(slope * at, slope * x[np.arange(1, blocks + 1) * size - 1])
    for block in np.flatnonzero(above < level).tolist():
        rows = slice(block * size, (block + 1) * size)
        low[rows] = y[rows] - slope * x[rows] < level[block]
    tail = slice(blocks * size, None)
    low[tail] = y[tail] - slope * x[tail] < level[-1]
    return low if low.sum() <= max(3, _FEW * len(x)) else none


def lower_line(x: Array, y: Array) -> tuple[float, float]:
    """Intercept and slope of the line below all points (n,) that lies closest to them on average.

    It is the edge of the lower convex hull above which the mean of x lies.
    """
    hx, hy = lower_hull(x, y)
    if len(hx) == 1:
        return float(hy[0]), 0.0
    right = int(np.clip(np.searchsorted(hx, x.mean()), 1, len(hx) - 1))
    slope = float((hy[right] - hy[right - 1]) / (hx[right] - hx[right - 1]))
    return float(hy[right] - slope * hx[right]), slope


def lower_hull(x: Array, y: Array) -> tuple[Array, Array]:
    """The corners (m,) of the lower convex hull of points x, y (n,) in any unit, x increasing."""
    if (x[1:] > x[:-1]).all():
        x, y = _may_be_corners(x, y)
    else:
        order = np.lexsort((y, x))
        x, y = x[order], y[order]
        once = np.concatenate([[True], np.diff(x) > 0])
        x, y = x[once], y[once]
    while len(x) > 2:
        # A point on or above the line between two others is no corner, whatever else is taken away with it.
        turn = (x[1:-1] - x[:-2]) * (y[2:] - y[:-2]) - (y[1:-1] - y[:-2]) * (x[2:] - x[:-2])
        corner = np.concatenate([[True], turn > 0, [True]])
        if corner.all():
            break
        x, y = x[corner], y[corner]
    return x, y


def _may_be_corners(x: Array, y: Array) -> tuple[Array, Array]:
    """The points (m,) among which all corners of the hull are, x increasing: those of blocks whose least is not above
    the hull of all blocks' least points, which is convex and so highest over a block at one of its ends."""
    blocks = len(x) // _HULL_BLOCK
    if blocks < _NEIGHBOURS:
        return x, y
    kept = np.zeros(len(x), dtype=bool)
    kept[0] = kept[-1] = kept[blocks * _HULL_BLOCK :] = True
    begins = np.arange(blocks) * _HULL_BLOCK
    lowest = begins + y[: len(begins) * _HULL_BLOCK].reshape(blocks, _HULL_BLOCK).argmin(axis=1)
    kept[lowest] = True
    over = np.interp([x[begins], x[begins + _HULL_BLOCK - 1]], *lower_hull(x[kept], y[kept])).max(axis=0)
    kept[: blocks * _HULL_BLOCK].reshape(blocks, _HULL_BLOCK)[y[lowest] <= over] = True
    return x[kept], y[kept]


def _broken(x: Array, y: Array, knots: Array) -> Array:
    """Heights (k,) at the knots of the broken line under all points that lies closest to them on average.

    A line lies under the points of its window where it lies under the corners of their hull: a small linear program.
    """
    edges = np.searchsorted(x, knots[1:-1], side="left")
    windows = list(zip(np.split(x, edges), np.split(y, edges), strict=True))
    corners = [lower_hull(*window) for window in windows if len(window[0])]
    corner_x, corner_y = (np.concatenate(of) for of in zip(*corners, strict=True))
    pull = np.zeros(len(knots))
    for k, (inside, _) in enumerate(windows):
        # A point pulls the knots left and right of it, each by its share.
        share = float((inside - knots[k]).sum() / (knots[k + 1] - knots[k]))
        pull[k : k + 2] += len(inside) - share, share
    offset, rate = lower_line(corner_x, corner_y)
    right = np.clip(np.searchsorted(knots, corner_x), 1, len(knots) - 1)
    share_at = (corner_x - knots[right - 1]) / (knots[right] - knots[right - 1])
    heights = highest_under(pull, right, share_at, corner_y - offset - rate * corner_x)
    straight = offset + rate * knots
    return straight if heights is None else straight + heights

"""Lower envelope of points raised by delays: a line through the least delayed points.

The envelope is straight over a short span. Over a long span a clock's rate follows the temperature, and the envelope is
a continuous polyline with a knot per window. In both cases it is the line below all points with the smallest mean
distance (for the straight line: Olson, A Passive Solution to the Sensor Synchronization Problem, IROS 2010).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from analysis.robot.kinematics.arm import Array, Integers

_TOLERANCE = 1e-10
"""Largest height of the polyline above a corner, relative to the range of the corners; the smallest of the solver."""


def highest_under(pull: Array, right: Integers, share: Array, corners: Array) -> Array | None:
    """Heights (k,) below all corners that maximise pull @ heights, or None if there is no solution.

    pull (k,): at least 0. right, share, corners (m,): a corner lies between knots right - 1 and right, at the relative
    position share, and has the ordinate corners, in the unit of the heights.
    """
    from scipy import optimize, sparse  # noqa: PLC0415 - slow to import, needed for long runs only

    size, rows = float(np.abs(corners).max()) or 1.0, np.arange(len(corners))
    places = np.concatenate([rows, rows]), np.concatenate([right - 1, right])
    at_corners: Any = sparse.csr_array(  # the stubs know dense matrices only
        (np.concatenate([1 - share, share]), places), shape=(len(corners), len(pull))
    )
    best = optimize.linprog(
        -pull / pull.sum(),
        at_corners,
        corners / size,
        bounds=(None, None),
        options={"primal_feasibility_tolerance": _TOLERANCE},
    )
    return np.asarray(best.x, dtype=float) * size if best.success else None


TICK_S = 1e-9
"""Resolution of host timestamps: 1 ns. A clock that advances by less is not advancing."""
WINDOW_S = 120.0
"""Interval of the knots. With the temperature of a hall, a crystal's rate changes by less than 0.01 ppm/s: 18 µs
over half of this window.
"""
_BLOCK = 8
_BLOCKS = 400
_HULL_BLOCK = 64
"""Initial block size in the search for hull corners. Only the lowest point of a block is examined."""
_NEIGHBOURS = 9
_SPREADS = 4.0
_SHORT_S = 50e-6
_FEW = 0.002
"""Largest share of points below their neighbours that are treated as errors. More numerous low points are valid."""

Mask = np.ndarray[tuple[int], np.dtype[np.bool_]]


def floor(x: Array, y: Array, window: float = WINDOW_S) -> tuple[Array, Mask]:
    """Lower envelope (n,) of y (n,) at increasing x (n,), both in s, and a mask of impossibly low points.

    At least two points are required. If there are few points, all are treated as valid.
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
    # The polyline is below all points of a window if it is below the corners of their hull. This keeps the linear
    # program small.
    under_x, under_y = under
    edges = np.searchsorted(under_x, knots[1:-1], side="left")
    pieces = list(zip(np.split(under_x, edges), np.split(under_y, edges), strict=True))
    corners = [lower_hull(*piece) for piece in pieces if len(piece[0])]
    corner_x, corner_y = (np.concatenate(of) for of in zip(*corners, strict=True))
    pull = np.zeros(len(knots))
    for k, (inside, _) in enumerate(pieces):
        # Each point contributes to the two adjacent knots, weighted by its position.
        share = float((inside - knots[k]).sum() / (knots[k + 1] - knots[k]))
        pull[k : k + 2] += len(inside) - share, share
    offset, rate = lower_line(corner_x, corner_y)
    right = np.clip(np.searchsorted(knots, corner_x), 1, len(knots) - 1)
    share_at = (corner_x - knots[right - 1]) / (knots[right] - knots[right - 1])
    rises = highest_under(pull, right, share_at, corner_y - offset - rate * corner_x)
    heights = offset + rate * knots + (0.0 if rises is None else rises)
    return np.interp(x, knots, heights), low


def low_outliers(x: Array, y: Array) -> Mask:
    """Mask of wrong timestamps y (n,) at increasing x (n,), in s: isolated values well below their neighbours.

    The minimum of each block is compared with those of the neighbouring blocks. At most one in 500 points, or three, is
    treated as wrong, because repeated low points are short delays.
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
    # The points of a block are not below its minimum minus the larger value of the line at the two ends of the block.
    above = least - np.maximum(slope * at, slope * x[np.arange(1, blocks + 1) * size - 1])
    for block in np.flatnonzero(above < level).tolist():
        rows = slice(block * size, (block + 1) * size)
        low[rows] = y[rows] - slope * x[rows] < level[block]
    tail = slice(blocks * size, None)
    low[tail] = y[tail] - slope * x[tail] < level[-1]
    return low if low.sum() <= max(3, _FEW * len(x)) else none


def lower_line(x: Array, y: Array) -> tuple[float, float]:
    """Intercept and slope, in units of x and y, of the line below all points (n,) with the smallest mean
    distance.

    The line is the edge of the lower convex hull at the mean of x.
    """
    hx, hy = lower_hull(x, y)
    if len(hx) == 1:
        return float(hy[0]), 0.0
    right = int(np.clip(np.searchsorted(hx, x.mean()), 1, len(hx) - 1))
    slope = float((hy[right] - hy[right - 1]) / (hx[right] - hx[right - 1]))
    return float(hy[right] - slope * hx[right]), slope


def lower_hull(x: Array, y: Array) -> tuple[Array, Array]:
    """Corners (m,) of the lower convex hull of points x, y (n,) in any unit, with increasing x."""
    blocks = len(x) // _HULL_BLOCK
    if not (x[1:] > x[:-1]).all():
        order = np.lexsort((y, x))
        x, y = x[order], y[order]
        once = np.concatenate([[True], np.diff(x) > 0])
        x, y = x[once], y[once]
    elif blocks >= _NEIGHBOURS:
        # A block contains corners only if its minimum is not above the hull of all block minima. This hull is convex
        # and therefore highest at an end of a block.
        kept = np.zeros(len(x), dtype=bool)
        kept[0] = kept[-1] = kept[blocks * _HULL_BLOCK :] = True
        begins = np.arange(blocks) * _HULL_BLOCK
        lowest = begins + y[: len(begins) * _HULL_BLOCK].reshape(blocks, _HULL_BLOCK).argmin(axis=1)
        kept[lowest] = True
        over = np.interp([x[begins], x[begins + _HULL_BLOCK - 1]], *lower_hull(x[kept], y[kept])).max(axis=0)
        kept[: blocks * _HULL_BLOCK].reshape(blocks, _HULL_BLOCK)[y[lowest] <= over] = True
        x, y = x[kept], y[kept]
    while len(x) > 2:
        # A point on or above the line between two others is not a corner, even if either was removed.
        turn = (x[1:-1] - x[:-2]) * (y[2:] - y[:-2]) - (y[1:-1] - y[:-2]) * (x[2:] - x[:-2])
        corner = np.concatenate([[True], turn > 0, [True]])
        if corner.all():
            break
        x, y = x[corner], y[corner]
    return x, y

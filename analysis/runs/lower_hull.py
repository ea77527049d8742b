"""Lower envelope of points raised by delays: a line through the least delayed points.

Straight over a short span; over a long one, where a clock's rate follows the temperature, a continuous polyline of
windows. Both are the lines below all points with the smallest mean distance (Olson, A Passive Solution to the Sensor
Synchronization Problem, IROS 2010, for the straight one).

The polyline is a linear program on a chain, in which each corner involves only the two adjacent knots: its normal
equations are tridiagonal, and a step costs as little for the clock of a day as for that of a minute. It is solved by a
predictor and corrector (Mehrotra, On the implementation of a primal-dual interior point method, 1992); importing
`scipy.optimize` takes longer than this solution.
"""

from __future__ import annotations

import numpy as np

from analysis.robot.kinematics.arm import Array, Integers

_ENOUGH = 1e-10
"""Permitted distance of the mean height from the optimum, relative to the range of the corners."""
_ROUNDS = 80
"""About 15 are usual."""
_SHORT = 0.995
"""Step length relative to the first bound."""


def highest_under(pull: Array, right: Integers, share: Array, corners: Array) -> Array | None:
    """Return heights (k,) that maximise pull @ heights, pull (k,) ≥ 0, with each corner (m,) on or above the polyline.

    A corner lies between knots right - 1 and right, at the relative position share (m,). None without convergence.
    """
    size, knots = float(np.abs(corners).max()) or 1.0, len(pull)
    bound, pull = corners / size, pull / pull.sum()

    def at_corners(heights: Array) -> Array:
        return np.asarray((1 - share) * heights[right - 1] + share * heights[right])

    def at_knots(weights: Array) -> Array:
        return _summed(right - 1, (1 - share) * weights, knots) + _summed(right, share * weights, knots)

    heights, price = np.full(knots, bound.min() - 1.0), np.full(len(bound), 1.0 / len(bound))
    space = bound - at_corners(heights)
    for _ in range(_ROUNDS):
        unpaid, gap = pull - at_knots(price), float(space @ price)
        if gap < _ENOUGH and np.abs(unpaid).max() < _ENOUGH:
            return heights * size
        stiff = price / space
        diagonal = _summed(right - 1, (1 - share) ** 2 * stiff, knots) + _summed(right, share**2 * stiff, knots)
        off_diagonal = _summed(right, share * (1 - share) * stiff, knots)[1:]
        aim, target = -space * price, np.zeros(len(bound))
        for _ in range(2):  # predictor step to the bounds, then a corrector step towards the central path
            rise = _solved(diagonal, off_diagonal, unpaid - at_knots(aim / space))
            taken = -at_corners(rise)
            paid = (aim - price * taken) / space
            ahead, dearer = _most(space, taken), _most(price, paid)
            gap_after = float((space + ahead * taken) @ (price + dearer * paid))
            target = (gap_after / gap) ** 3 * gap / len(bound) - taken * paid
            aim, last = -space * price + target, (rise, ahead, paid, dearer)
        rise, ahead, paid, dearer = last
        heights, price = heights + ahead * rise, price + dearer * paid
        space = bound - at_corners(heights)
        if not (space > 0).all():
            return None
    return None


def _summed(knot: Integers, weights: Array, knots: int) -> Array:
    """Return the sums of weights (m,) per knot (k,)."""
    return np.bincount(knot, weights, knots).astype(np.float64)


def _most(values: Array, change: Array) -> float:
    """Return the largest share of a change, at most 1, that keeps positive values (m,) positive."""
    falls = change < 0
    return min(1.0, _SHORT * float((-values[falls] / change[falls]).min(initial=np.inf)))


def _solved(diagonal: Array, off_diagonal: Array, target: Array) -> Array:
    """Solve symmetric tridiagonal equations with diagonal (k,) and off-diagonal (k - 1,) by elimination: (k,).

    An unconstrained knot stays unchanged.
    """
    pivots, values, sides = np.where(diagonal > 0, diagonal, 1.0).tolist(), target.tolist(), off_diagonal.tolist()
    for k, side in enumerate(sides):
        share = side / pivots[k]
        pivots[k + 1] = max(pivots[k + 1] - share * side, 1e-14 * pivots[k + 1])
        values[k + 1] -= share * values[k]
    values[-1] /= pivots[-1]
    for k in range(len(sides) - 1, -1, -1):
        values[k] = (values[k] - sides[k] * values[k + 1]) / pivots[k]
    return np.array(values)


TICK_S = 1e-9
"""Host stamps count nanoseconds: smaller advances are indistinguishable from standstill."""
WINDOW_S = 120.0
"""A crystal's rate changes by less than 0.01 ppm/s with the temperature of a hall: 18 µs over half of this window."""
_BLOCK = 8
_BLOCKS = 400
_HULL_BLOCK = 64
"""Initial block size, of which only the lowest point is examined."""
_NEIGHBOURS = 9
_SPREADS = 4.0
_SHORT_S = 50e-6
_FEW = 0.002
"""Largest share of points treated as errors below their neighbours; more of them define the line."""

Mask = np.ndarray[tuple[int], np.dtype[np.bool_]]


def floor(x: Array, y: Array, window: float = WINDOW_S) -> tuple[Array, Mask]:
    """Return the line (n,) below points y (n,) at increasing x (n,), both in s, and a mask of impossibly low points.

    Requires two points. Raises nothing: with few points none is treated as wrong.
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
    # A polyline is below the points of its window if it is below the corners of their hull: a small linear program.
    under_x, under_y = under
    edges = np.searchsorted(under_x, knots[1:-1], side="left")
    pieces = list(zip(np.split(under_x, edges), np.split(under_y, edges), strict=True))
    corners = [lower_hull(*piece) for piece in pieces if len(piece[0])]
    corner_x, corner_y = (np.concatenate(of) for of in zip(*corners, strict=True))
    pull = np.zeros(len(knots))
    for k, (inside, _) in enumerate(pieces):
        # A point pulls the two adjacent knots by its shares.
        share = float((inside - knots[k]).sum() / (knots[k + 1] - knots[k]))
        pull[k : k + 2] += len(inside) - share, share
    offset, rate = lower_line(corner_x, corner_y)
    right = np.clip(np.searchsorted(knots, corner_x), 1, len(knots) - 1)
    share_at = (corner_x - knots[right - 1]) / (knots[right] - knots[right - 1])
    rises = highest_under(pull, right, share_at, corner_y - offset - rate * corner_x)
    heights = offset + rate * knots + (0.0 if rises is None else rises)
    return np.interp(x, knots, heights), low


def low_outliers(x: Array, y: Array) -> Mask:
    """Return a mask of y (n,) at increasing x (n,), both in s, isolated below the minimum of their neighbours: wrong
    stamps.

    Block minima are compared with their neighbours. At most one in 500 (or three) is treated as wrong: repeated low
    points are short delays.
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
    # Points of a block are not below its minimum, less the larger of the line's two ends.
    above = least - np.maximum(slope * at, slope * x[np.arange(1, blocks + 1) * size - 1])
    for block in np.flatnonzero(above < level).tolist():
        rows = slice(block * size, (block + 1) * size)
        low[rows] = y[rows] - slope * x[rows] < level[block]
    tail = slice(blocks * size, None)
    low[tail] = y[tail] - slope * x[tail] < level[-1]
    return low if low.sum() <= max(3, _FEW * len(x)) else none


def lower_line(x: Array, y: Array) -> tuple[float, float]:
    """Return intercept and slope (units of x and y) of the line below all points (n,) with the smallest mean distance.

    It is the edge of the lower convex hull above the mean of x.
    """
    hx, hy = lower_hull(x, y)
    if len(hx) == 1:
        return float(hy[0]), 0.0
    right = int(np.clip(np.searchsorted(hx, x.mean()), 1, len(hx) - 1))
    slope = float((hy[right] - hy[right - 1]) / (hx[right] - hx[right - 1]))
    return float(hy[right] - slope * hx[right]), slope


def lower_hull(x: Array, y: Array) -> tuple[Array, Array]:
    """Return the corners (m,) of the lower convex hull of points x, y (n,) in any unit, x increasing."""
    blocks = len(x) // _HULL_BLOCK
    if not (x[1:] > x[:-1]).all():
        order = np.lexsort((y, x))
        x, y = x[order], y[order]
        once = np.concatenate([[True], np.diff(x) > 0])
        x, y = x[once], y[once]
    elif blocks >= _NEIGHBOURS:
        # All corners are in blocks whose minimum is not above the hull of all block minima, which is convex and
        # therefore highest at an
        # end of a block.
        kept = np.zeros(len(x), dtype=bool)
        kept[0] = kept[-1] = kept[blocks * _HULL_BLOCK :] = True
        begins = np.arange(blocks) * _HULL_BLOCK
        lowest = begins + y[: len(begins) * _HULL_BLOCK].reshape(blocks, _HULL_BLOCK).argmin(axis=1)
        kept[lowest] = True
        over = np.interp([x[begins], x[begins + _HULL_BLOCK - 1]], *lower_hull(x[kept], y[kept])).max(axis=0)
        kept[: blocks * _HULL_BLOCK].reshape(blocks, _HULL_BLOCK)[y[lowest] <= over] = True
        x, y = x[kept], y[kept]
    while len(x) > 2:
        # A point on or above the line between two others is not a corner, independent of other removed points.
        turn = (x[1:-1] - x[:-2]) * (y[2:] - y[:-2]) - (y[1:-1] - y[:-2]) * (x[2:] - x[:-2])
        corner = np.concatenate([[True], turn > 0, [True]])
        if corner.all():
            break
        x, y = x[corner], y[corner]
    return x, y

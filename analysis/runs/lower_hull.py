"""The line under points that delay can only lift: through the least delayed, whatever the others do.

A straight line over a short span; over a long one, where a clock's rate follows the temperature, a broken line of
windows joined without a step. Both are the line under all points that lies closest to them on average (Olson, A
Passive Solution to the Sensor Synchronization Problem, IROS 2010, for the straight one).

The broken one is a linear program of a chain, whose corners bind the two knots beside them alone: its normal equations
have three diagonals, and one step costs as little for the clock of a day as for that of a minute. A predictor and a
corrector solve it (Mehrotra, On the implementation of a primal-dual interior point method, 1992); `scipy.optimize`
takes longer to import than this takes to solve.
"""

from __future__ import annotations

import numpy as np

from analysis.robot.kinematics.arm import Array, Integers

_ENOUGH = 1e-10
"""Share of the corners' range by which the mean height may lie below the best."""
_ROUNDS = 80
"""Some 15 are usual."""
_SHORT = 0.995
"""Share of the way to the first bound that a step goes."""


def highest_under(pull: Array, right: Integers, share: Array, corners: Array) -> Array | None:
    """Heights (k,) that make pull @ heights largest, pull (k,) ≥ 0, where each corner (m,) lies on the line or above.

    A corner lies between knots right - 1 and right, the share (m,) of the way. None where no such line was reached."""
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
        for _ in range(2):  # the step to the bounds themselves, then one that keeps in the middle on the way there
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
    """The weights (m,) of each knot (k,) together."""
    return np.bincount(knot, weights, knots).astype(np.float64)


def _most(values: Array, change: Array) -> float:
    """How much of a change, at the most all, leaves positive values (m,) positive."""
    falls = change < 0
    return min(1.0, _SHORT * float((-values[falls] / change[falls]).min(initial=np.inf)))


def _solved(diagonal: Array, off_diagonal: Array, target: Array) -> Array:
    """The solution (k,) of symmetric equations with a diagonal (k,) and what is beside it (k - 1,), by elimination. A
    knot that nothing binds stays where it is."""
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
    # A broken line lies under the points of its window where it lies under the corners of their hull: a small linear
    # program.
    under_x, under_y = under
    edges = np.searchsorted(under_x, knots[1:-1], side="left")
    pieces = list(zip(np.split(under_x, edges), np.split(under_y, edges), strict=True))
    corners = [lower_hull(*piece) for piece in pieces if len(piece[0])]
    corner_x, corner_y = (np.concatenate(of) for of in zip(*corners, strict=True))
    pull = np.zeros(len(knots))
    for k, (inside, _) in enumerate(pieces):
        # A point pulls the knots left and right of it, each by its share.
        share = float((inside - knots[k]).sum() / (knots[k + 1] - knots[k]))
        pull[k : k + 2] += len(inside) - share, share
    offset, rate = lower_line(corner_x, corner_y)
    right = np.clip(np.searchsorted(knots, corner_x), 1, len(knots) - 1)
    share_at = (corner_x - knots[right - 1]) / (knots[right] - knots[right - 1])
    rises = highest_under(pull, right, share_at, corner_y - offset - rate * corner_x)
    heights = offset + rate * knots + (0.0 if rises is None else rises)
    return np.interp(x, knots, heights), low


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
    blocks = len(x) // _HULL_BLOCK
    if not (x[1:] > x[:-1]).all():
        order = np.lexsort((y, x))
        x, y = x[order], y[order]
        once = np.concatenate([[True], np.diff(x) > 0])
        x, y = x[once], y[once]
    elif blocks >= _NEIGHBOURS:
        # All corners are among the points of blocks whose least is not above the hull of all blocks' least points,
        # which is convex and so highest over a block at one of its ends.
        kept = np.zeros(len(x), dtype=bool)
        kept[0] = kept[-1] = kept[blocks * _HULL_BLOCK :] = True
        begins = np.arange(blocks) * _HULL_BLOCK
        lowest = begins + y[: len(begins) * _HULL_BLOCK].reshape(blocks, _HULL_BLOCK).argmin(axis=1)
        kept[lowest] = True
        over = np.interp([x[begins], x[begins + _HULL_BLOCK - 1]], *lower_hull(x[kept], y[kept])).max(axis=0)
        kept[: blocks * _HULL_BLOCK].reshape(blocks, _HULL_BLOCK)[y[lowest] <= over] = True
        x, y = x[kept], y[kept]
    while len(x) > 2:
        # A point on or above the line between two others is no corner, whatever else is taken away with it.
        turn = (x[1:-1] - x[:-2]) * (y[2:] - y[:-2]) - (y[1:-1] - y[:-2]) * (x[2:] - x[:-2])
        corner = np.concatenate([[True], turn > 0, [True]])
        if corner.all():
            break
        x, y = x[corner], y[corner]
    return x, y

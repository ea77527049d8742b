"""The heights of the broken line under corners that lies highest on average: a linear program of a chain.

Each corner binds the two knots beside it alone, so the normal equations have three diagonals, and one step costs as
little for the clock of a day as for that of a minute. A predictor and a corrector (Mehrotra, On the implementation of a
primal-dual interior point method, 1992); `scipy.optimize` takes longer to import than this takes to solve.
"""

from __future__ import annotations

import numpy as np

from analysis.kinematics.arm import Array, Integers

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

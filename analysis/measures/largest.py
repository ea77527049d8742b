"""The largest size of a noisy curve, and where it lies.

The maximum of a noisy curve is chosen by its noise and too large on average; by how much depends on how many places
come near it. On a plateau, as a play makes one between two reversals, any place may be the largest. So the curve is
flattened: all that stands above some level is taken for noise, and that level is the size of which the observed
maximum is the median, with the same noise again. It is the least favourable curve that the readings allow, as in the
half-median-unbiased bounds of Chernozhukov, Lee and Rosen (Intersection bounds, Econometrica 2013).
"""

from __future__ import annotations

import numpy as np

from analysis.kinematics.arm import Array
from analysis.measures.lap_curve import RANGE_U, blurred
from analysis.measures.quantity import PLACE, Quantity, figures_of, from_draws
from analysis.measures.reduction import PHI

_SURE = 0.9545
"""Share of the draws that 2 u covers."""
_ROUNDS = 2
"""Rounds in which a plateau is found: the wider it is, the further below its maximum one of its places may be read."""
_HALVINGS = 10
"""Halvings of the interval between the bounds of the level: to a thousandth of what noise adds."""


def largest(curve: Array, errors: Array, blur: float, unit: str, samples: int) -> tuple[Quantity, Quantity]:
    """The largest size of a curve (NODES,) without sign, and the place of it, with errors (m, NODES) that noise may
    have put into it. Its rows fell anywhere about their places with a standard deviation of `blur` rad, which takes
    something off a narrow peak."""
    peak = int(np.argmax(np.abs(curve)))
    top = float(np.abs(curve[peak]))
    level = _level(curve * np.sign(curve[peak]), errors * np.sign(curve[peak]))
    flat = np.clip(curve, -level, level)
    lost = max(level - float(np.abs(blurred(flat, blur)).max()), 0.0)
    again = np.abs(flat + errors)
    u = float(np.sqrt(from_draws(0.0, again.max(axis=1), unit).u ** 2 + (RANGE_U * (top - level)) ** 2 + lost**2))
    # Nodes may have the largest size that lie no further below the maximum than one place of a plateau may be read.
    for _ in range(_ROUNDS):
        below = float(np.quantile(again.max(axis=1) - again[:, peak], _SURE))
        flat = np.where(np.abs(curve) >= top - below, np.abs(flat[peak]) * np.sign(curve), flat)
        again = np.abs(flat + errors)
    at = np.degrees(PHI)
    place = figures_of({PLACE: float(at[peak])}, {PLACE: at[again.argmax(axis=1)]}, samples)[PLACE]
    return Quantity(level + lost, u, unit, samples), place


def _level(curve: Array, errors: Array) -> float:
    """The level, not below zero, at which a curve (NODES,) with a positive maximum is cut off, so that with errors
    (m, NODES) again its largest value has that maximum as its median."""
    top = float(curve.max())
    low, high = max(top - float(np.median(errors.max(axis=1))), 0.0), top
    for _ in range(_HALVINGS):
        level = (low + high) / 2
        if float(np.median((np.minimum(curve, level) + errors).max(axis=1))) > top:
            high = level
        else:
            low = level
    return (low + high) / 2

"""Joint angles modulo a turn: an arm whose wrist winds on stands in one posture turns apart."""

from __future__ import annotations

import numpy as np

from analysis.kinematics.arm import Array

_MOST_RAD = 4 * np.pi + 0.1
"""An axis that cables pass through turns by no more than two turns each way. …"""
_WIND = 2
"""… Wrists wind on without an end: axis 6, and axis 4 of arms whose circle goes round it (UR e-series, wrist 3; ABB,
independent axis)."""


def wrapped(angle: Array) -> Array:
    """The same angles (n, …) rad in (-180°, 180°]."""
    wrapped: Array = angle - 2 * np.pi * np.ceil(angle / (2 * np.pi) - 0.5)
    return wrapped


def impossible_rad(q: Array) -> float:
    """The largest angle, rad, of joints q (n, axes) rad of which more have turned than wind on in any arm: such angles
    are of another unit. 0 where none have."""
    most = np.abs(q).max(axis=0, initial=0.0)
    return float(most.max(initial=0.0)) if np.count_nonzero(most > _MOST_RAD) > _WIND else 0.0

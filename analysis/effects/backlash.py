"""Backlash: the link lags behind in a play, -w/2 while q rises, +w/2 while it falls.

The play operator (Visintin, Differential Models of Hysteresis, 1994): y follows x only when x pushes
against one side of the gap. Over a stretch on which x is monotone it has the closed form used here.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from analysis.kinematics.arm import Array
from rigs.effects import Backlash


def deviation(effect: Backlash, q: Array) -> Array:
    """Link side less reported, (n,) rad. The trace begins in the middle of the play."""
    half = np.radians(effect.width_deg) / 2
    link = np.empty_like(q)
    y = q[0]
    turns = np.flatnonzero(np.diff(np.sign(np.diff(q)))) + 1
    # A turning point ends its stretch: the play is fully taken up there before it is left.
    edges = [0, *(turns + 1).tolist(), len(q)]
    for start, stop in pairwise(edges):
        stretch = q[start:stop]
        # On a monotone stretch at most one of the two bounds is ever active.
        link[start:stop] = np.clip(y, stretch - half, stretch + half)
        y = link[stop - 1]
    return link - q

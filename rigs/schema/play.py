"""The play operator: what follows in a gap, as a link in its gear or a plunger that sticks."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from rigs.schema.scene import Array


def play(x: Array, half: float) -> Array:
    """The follower y (n,) of x (n,) in a gap of ± half; it begins in the middle.

    The play operator (Visintin, Differential Models of Hysteresis, 1994): y moves only when x pushes one side of the
    gap. Over a stretch on which x is monotone it has the closed form used here.
    """
    follower = np.empty_like(x)
    y = x[0]
    way = np.sign(np.diff(x))
    moving = np.flatnonzero(way)
    # Where x stands it goes on as it came: rounded angles stand at every other sample.
    turns = moving[1:][way[moving[1:]] != way[moving[:-1]]]
    # A turning point ends its stretch: the play is fully taken up there before it is left.
    for start, stop in pairwise([0, *(turns + 1).tolist(), len(x)]):
        stretch = x[start:stop]
        # On a monotone stretch at most one of the two bounds is ever active.
        follower[start:stop] = np.clip(y, stretch - half, stretch + half)
        y = follower[stop - 1]
    return follower

"""The play operator: what follows in a gap, as a link in its gear or a plunger that sticks."""

from __future__ import annotations

import numpy as np

from rigs.schema.scene import Array


def play(x: Array, half: float, begin: float = 0.0) -> Array:
    """The follower y (n,) of x (n,) in a gap of ± half; it begins in the middle, or `begin` (-1 … 1) of half beside it.

    The play operator (Visintin, Differential Models of Hysteresis, 1994): y moves only when x pushes one side of the
    gap. Over a stretch on which x is monotone it has the closed form used here.
    """
    follower: Array = plays(x, np.array([half]), begin)[0]
    return follower


def plays(x: Array, half: Array, begin: float = 0.0) -> Array:
    """The followers (w, n) of x (n,) in gaps of ± half (w,), all in the unit of x; each begins in the middle, or
    `begin` (-1 … 1) of its half beside it."""
    way = np.sign(np.diff(x))
    moving = np.flatnonzero(way)
    # Where x stands it goes on as it came: rounded angles stand at every other sample.
    turns = moving[1:][way[moving[1:]] != way[moving[:-1]]]
    # A turning point ends its stretch: the play is fully taken up there before it is left.
    ends = x[turns].tolist()
    entered = np.array([_entered(float(x[0]) + begin * gap, ends, gap) for gap in half.tolist()])
    stretches = np.diff([0, *(turns + 1).tolist(), len(x)])
    # On a monotone stretch at most one of the two bounds is ever active. In place this takes a quarter of the time.
    followers: Array = np.repeat(entered, stretches, axis=1)
    bound = x - half[:, None]
    np.maximum(followers, bound, out=followers)
    np.add(x, half[:, None], out=bound)
    np.minimum(followers, bound, out=followers)
    return followers


def _entered(first: float, ends: list[float], half: float) -> list[float]:
    """Where the follower is as it enters each stretch, from where x is at the end of the stretches before it."""
    entered = [first]
    for end in ends:
        if first < end - half:
            first = end - half
        elif first > end + half:
            first = end + half
        entered.append(first)
    return entered

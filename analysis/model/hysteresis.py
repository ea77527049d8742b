"""Memory of direction: the play operator, and where a joint turns back."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from analysis.kinematics.arm import Array

_TURN_RAD = np.radians(0.003)
"""Less than this is an encoder's noise, not a reversal."""
_NEAR_S = 0.25
_LEAST = 5


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


def turns(t_s: Array, x: Array) -> list[tuple[float, float]]:
    """When x (n,) rad turns back, and the direction (±1) it takes then."""
    follower = play(x, _TURN_RAD / 2)
    moving = np.flatnonzero(np.diff(follower))
    direction = np.sign(np.diff(follower)[moving])
    found = []
    for k in np.flatnonzero(np.diff(direction)):
        # The follower moves again only after the play; the turn itself was at the extreme before that.
        between = slice(moving[k], moving[k + 1] + 1)
        extreme = moving[k] + int(np.argmin(direction[k + 1] * x[between]))
        found.append((_vertex(t_s, x, extreme), float(direction[k + 1])))
    return found


def _vertex(t_s: Array, x: Array, extreme: int) -> float:
    """When x (n,) turned, between samples: the vertex of a parabola through those about its extreme."""
    last = extreme + int(np.argmax(np.append(x[extreme:] != x[extreme], True))) - 1
    if np.count_nonzero(np.abs(t_s - t_s[extreme]) <= _NEAR_S) < _LEAST:
        # Of a program's stops: it stands there, and turns back as it leaves.
        return float(t_s[last])
    # Rounded angles stand about their turn.
    middle = (extreme + last) // 2
    near = np.flatnonzero(np.abs(t_s - t_s[middle]) <= _NEAR_S)
    since = t_s[near] - t_s[middle]
    bend, slope, _ = np.polyfit(since, x[near] - x[middle], 2)
    shift = -slope / (2 * bend) if bend else np.inf
    step = float(np.max(np.diff(since)))
    # Where the samples make no parabola, as about a stop, the extreme itself is as good as anything.
    return float(t_s[middle] + shift) if abs(shift) <= 2 * step else float(t_s[middle])

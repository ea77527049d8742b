"""Memory of direction: where a joint turns back."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from analysis.kinematics.arm import Array, Integers
from rigs.schema.play import play

_TURN_RAD = np.radians(0.003)
"""Less than this is an encoder's noise, not a reversal."""
_NEAR_S = 0.25
_LEAST = 5


@dataclass(frozen=True, eq=False)
class Motion:
    """Reported angles q (n, 6) rad at t_s (n,). Where its joints turn back is computed once and shared."""

    t_s: Array
    q: Array
    _reversals: dict[int, list[tuple[float, float]]] = field(default_factory=dict, init=False, repr=False)

    def reversals(self, axis: int) -> list[tuple[float, float]]:
        """When a joint (1 … 6) turns back, s, and the direction (±1) it takes then."""
        if axis not in self._reversals:
            self._reversals[axis] = turns(self.t_s, self.q[:, axis - 1])
        return self._reversals[axis]


def turns(t_s: Array, x: Array) -> list[tuple[float, float]]:
    """When x (n,) rad turns back, and the direction (±1) it takes then."""
    follower = play(x, _TURN_RAD / 2)
    moving = np.flatnonzero(np.diff(follower))
    direction = np.sign(np.diff(follower)[moving])
    changes = np.append(np.flatnonzero(np.diff(x)), len(x) - 1)
    found = []
    for k in np.flatnonzero(np.diff(direction)):
        # The follower moves again only after the play; the turn itself was at the extreme before that.
        between = slice(moving[k], moving[k + 1] + 1)
        extreme = moving[k] + int(np.argmin(direction[k + 1] * x[between]))
        last = int(changes[np.searchsorted(changes, extreme)])
        found.append((_vertex(t_s, x, extreme, last), float(direction[k + 1])))
    return found


def _vertex(t_s: Array, x: Array, extreme: int, last: int) -> float:
    """When x (n,) turned, between samples: the vertex of a parabola through those about its extreme, at which it stands
    until `last`."""
    if len(_near(t_s, extreme)) < _LEAST:
        # Of a program's stops: it stands there, and turns back as it leaves.
        return float(t_s[last])
    # Rounded angles stand about their turn.
    middle = (extreme + last) // 2
    near = _near(t_s, middle)
    since = t_s[near] - t_s[middle]
    bend, slope, _ = np.polyfit(since, x[near] - x[middle], 2)
    shift = -slope / (2 * bend) if bend else np.inf
    step = float(np.max(np.diff(since)))
    # Where the samples make no parabola, as about a stop, the extreme itself is as good as anything.
    return float(t_s[middle] + shift) if abs(shift) <= 2 * step else float(t_s[middle])


def _near(t_s: Array, k: int) -> Integers:
    """Indices of the samples whose times t_s (n,) s are near that of sample k."""
    first, end = np.searchsorted(t_s, t_s[k] + 2 * _NEAR_S * np.array([-1, 1]))
    near: Integers = first + np.flatnonzero(np.abs(t_s[first:end] - t_s[k]) <= _NEAR_S)
    return near

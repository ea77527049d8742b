"""Touches as a person makes them: joint angles in, touches of sockets out.

It owns no clock and no daemon. A robot that stands still after it moved has its ball in the socket, if the arm says so
within what arms err by; elsewhere it only rests. Each joint's last turning point says from which side it came, and so
on which flank of its play it stands.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from analysis.kinematics.arm import Arm, Array, forward
from analysis.traces.tables import TouchTable

STANDS_S = 1.5
"""How long the robot stands until a touch is taken: a guided arm swings for some tenths of a second when let go."""
_STILL_DEG = 0.03
"""A joint at rest flickers by less, as in `analysis.session.watch`."""
_MOVED_DEG = 3.0
"""How far some joint moves between touches: the ball need not leave the socket, and the same posture again shows
nothing but scatter."""
_TURNED_DEG = 0.02
"""Way of a joint beyond which it has turned back; less is the flicker of its encoder."""
_SAME_MM = 30.0
"""How far a ball is from the first touch of its socket by the nominal arm, at the most: arms err by 10 mm."""

Seen = Literal["nothing", "seated", "elsewhere", "same posture"]
"""What is seen: a touch was taken; the robot stands elsewhere; or it stands as at the touch before."""


class Touching:
    """Takes touches of one socket after the other, the same number of each."""

    def __init__(self, arm: Arm, sockets: Sequence[str], touches: int) -> None:
        """arm: with the ball as its tool; touches: of all sockets together."""
        self._arm, self._sockets, self._each = arm, tuple(sockets), -(-touches // len(sockets))
        self._names: list[str] = []
        self._q: list[Array] = []
        self._came: list[Array] = []
        self._first_mm: Array | None = None
        self._sides: _Sides | None = None
        self._since_s, self._stands_at = 0.0, np.empty(0)
        self._told = False

    @property
    def socket(self) -> str:
        """The socket that is touched now; empty where all have their touches."""
        done = len(self._names) // self._each
        return self._sockets[done] if done < len(self._sockets) else ""

    @property
    def number(self) -> int:
        """Which touch of the socket comes next, from 1."""
        return len(self._names) % self._each + 1

    @property
    def each(self) -> int:
        """How many touches a socket has."""
        return self._each

    @property
    def count(self) -> int:
        """How many touches there are."""
        return len(self._names)

    @property
    def table(self) -> TouchTable:
        """The touches so far; there must be one."""
        return TouchTable(np.array(self._names), np.radians(self._q), np.radians(self._came))

    def feed(self, t_s: float, joints_deg: Sequence[float] | Array) -> Seen:
        """Take in where the joints (axes,) are, in degrees, at a time in s, and return what is seen, each once."""
        q = np.asarray(joints_deg, dtype=float)
        if self._sides is None:
            self._sides, self._stands_at, self._since_s = _Sides(q), q, t_s
        self._sides.feed(q)
        if np.abs(q - self._stands_at).max() > _STILL_DEG:
            self._stands_at, self._since_s, self._told = q, t_s, False
        if self._told or not self.socket or t_s - self._since_s < STANDS_S:
            return "nothing"
        self._told = True
        if self._q and np.abs(q - self._q[-1]).max() < _MOVED_DEG:
            return "same posture"
        ball = forward(self._arm, np.radians(q)[None])[0, :3, 3]
        if self.number == 1:
            self._first_mm = ball
        elif self._first_mm is not None and np.linalg.norm(ball - self._first_mm) > _SAME_MM:
            return "elsewhere"
        self._names.append(self.socket)
        self._q.append(q)
        self._came.append(self._sides.from_deg.copy())
        return "seated"


class _Sides:
    """From where each joint came in its last move in one direction, in degrees."""

    def __init__(self, q: Array) -> None:
        self.from_deg = q.copy()
        self._furthest = q.copy()
        self._way = np.zeros(len(q))

    def feed(self, q: Array) -> None:
        """Take in the angles (axes,) of the joints, in degrees."""
        back = (q - self._furthest) * np.where(self._way == 0, -np.sign(q - self._furthest), self._way)
        turned = back < -_TURNED_DEG
        self.from_deg = np.where(turned, self._furthest, self.from_deg)
        self._way = np.where(turned, np.sign(q - self._furthest), self._way)
        ahead = turned | ((q - self._furthest) * self._way > 0)
        self._furthest = np.where(ahead, q, self._furthest)

"""Which program the robot drives, and how far it is: joint angles in, what happened out.

It owns no clock and no daemon, so that an hour of a cell is tested in milliseconds. Each program is known by the joint
angles along its whole way. A robot that stands where a program begins is about to drive it; a robot that leaves the way
drives something else. The way of a lap and that of the way back are the same places, so progress only ever grows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from analysis.apps.makers.programs.motion_plan import Dwell, Move, Plan, angles_along, end_of, start_of
from analysis.robot.kinematics.arm import Array
from analysis.runs.stands import FLICKER_DEG

NEAR_DEG = 1.0
"""A robot whose joints are all so near to the start of a program stands there. Chosen: corrected programs begin some
hundredths of a degree beside the nominal ones, and starts of different programs differ by tens of degrees."""
_ASTRAY_DEG = 5.0
"""A robot that is further from every place of the way drives something else. Chosen: between targets a controller may
move its joints a little otherwise than planned."""
_STANDS_S = 0.5
_ENDED_S = 2.0
"""A robot that stands so long at the end of its way has ended: programs stand there for 3 s."""
_MORE_S = 3.0
"""It has been stopped if it stands for twice its longest planned stand and so much more elsewhere."""
_ELSEWHERE_S = 4.0
_MEANT_S = 4.0
"""A robot that stood at the start of another program from the first look on is about to drive it if it stays there: the
person may be on the way to the program that was asked for."""
_STEP_DEG = 0.5
"""Between places of a way. Chosen: a tenth of what counts as astray."""
_AHEAD = 240
"""Places of the way that are looked at ahead of where the robot was: 120 degrees of the fastest joint, which none
passes between two looks."""
_NEARLY, _LAST = 0.99, 4
"""A robot that stands at the end is seen within the last hundredth of its way, or at one of so many last places: the
first of those that are near is taken, and a way of a small circle has but seventy."""

Seen = Literal["nothing", "at_start", "driving", "ended", "stopped", "astray", "elsewhere"]
"""What is seen: a program is about to begin; it is driven; it has ended; it was stopped; the robot has left its way; or
it moved and stands where no program begins."""


@dataclass(frozen=True)
class Way:
    """The way of a program: joint angles q_deg (n, 6) at even distances, and its longest stand in s."""

    q_deg: Array
    longest_stand_s: float

    @classmethod
    def of(cls, plan: Plan) -> Way:
        """Return the way of a plan, from where it begins."""
        moves = [step for step in plan.steps if isinstance(step, Move)]
        pieces = [start_of(plan).q[None]]
        for before, move in pairwise(moves):
            pieces.append(angles_along(end_of(before), move))
        at_end = max((k for k, step in enumerate(plan.steps) if isinstance(step, Move)), default=0)
        stands = [step.seconds for step in plan.steps[:at_end] if isinstance(step, Dwell)]
        # Angles (n, 6) at even distances along a polyline of angles (m, 6)
        q_deg = np.degrees(np.concatenate(pieces))
        far = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(q_deg, axis=0)).max(axis=1))])
        at = np.linspace(0.0, far[-1], 2 + int(far[-1] / _STEP_DEG))
        return cls(np.stack([np.interp(at, far, joint) for joint in q_deg.T], axis=1), max(stands, default=0.0))


class Watch:
    """Follows one step: waits for the expected program or another known one, then follows it to its end."""

    def __init__(self, ways: Mapping[str, Way], expected: str, ended: str = "") -> None:
        """ended: the program that was driven to its end before, at which the robot may still stand."""
        self._ways, self._expected, self._ended = ways, expected, ended
        self.program = ""
        """The program that is about to begin or is driven."""
        self._at = 0
        self._has_moved = False
        self._first: Array | None = None
        self._stands_at: Array = np.full(6, np.inf)
        self._stands_since_s = 0.0
        self.stood_s = 0.0
        """How long the robot has stood where it is."""

    def forget(self) -> None:
        """Wait again, as at the beginning, where the program that was followed has ended."""
        self._ended, self._has_moved, self._first = self.program, False, None
        self.program, self._at = "", 0

    @property
    def share(self) -> float:
        """How much of its way the robot has driven."""
        return self._at / max(1, len(self._ways[self.program].q_deg) - 1) if self.program else 0.0

    def feed(self, t_s: float, joints_deg: Sequence[float] | Array) -> Seen:
        """Take in where the joints (6,) are at a time, and return what is seen."""
        q = np.asarray(joints_deg, dtype=float)
        if self._first is None:
            self._first = q
        self._has_moved = self._has_moved or _apart(q, self._first) > NEAR_DEG
        if _apart(q, self._stands_at) > FLICKER_DEG:
            self._stands_at, self._stands_since_s = q, t_s
        self.stood_s = t_s - self._stands_since_s
        if not self.program:
            return self._await(q)
        way = self._ways[self.program]
        ahead = way.q_deg[self._at : self._at + _AHEAD]
        away = np.abs(ahead - q).max(axis=1)
        if away.min() > _ASTRAY_DEG:
            return "astray"
        # The first of the near places: where the way turns back, the same place comes again soon after.
        self._at += int((away <= away.min() + _STEP_DEG).argmax())
        is_last = self.share >= _NEARLY or self._at > len(way.q_deg) - 1 - _LAST
        if is_last and self.stood_s >= _ENDED_S:
            return "ended"
        if self._at > 0 and self.stood_s > 2 * way.longest_stand_s + _MORE_S:
            return "stopped"
        return "driving" if self._at else "at_start"

    def _await(self, q: Array) -> Seen:
        if self.stood_s < _STANDS_S:
            return "nothing"
        # Where a program ends another may begin: only the expected one is taken for meant where the robot stayed there.
        stayed = not self._has_moved and self._ended and _apart(q, self._ways[self._ended].q_deg[-1]) < NEAR_DEG
        is_meant = self._has_moved or (not stayed and self.stood_s > _MEANT_S)
        for name in (self._expected, *(self._ways if is_meant else ())):
            if _apart(q, self._ways[name].q_deg[0]) < NEAR_DEG:
                self.program, self._at = name, 0
                return "at_start"
        return "elsewhere" if self._has_moved and self.stood_s > _ELSEWHERE_S else "nothing"


def _apart(first: Array, second: Array) -> float:
    return float(np.abs(first - second).max())

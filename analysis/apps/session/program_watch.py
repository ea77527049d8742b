"""Detection of the driven program and its progress from joint angles, without a clock or a daemon.

The outward and return paths pass through the same places, so progress never decreases.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from analysis.apps.makers.motion_plan import Dwell, MotionPlan, Move, angles_along, end_of, start_of
from analysis.robot.kinematics.arm import Array
from analysis.runs.stands import FLICKER_DEG

NEAR_DEG = 1.0
"""Largest distance of each joint from the start of a program. Chosen: corrected programs start hundredths of a degree
away, other programs tens of degrees.
"""
_ASTRAY_DEG = 5.0
"""Distance from the path above which the robot drives something else. Chosen: controllers deviate slightly between
targets.
"""
_STANDSTILL_S = 0.5
_ENDED_S = 2.0
"""Standstill at the end of the path after which a program has ended: programs pause there for 3 s."""
_MORE_S = 3.0
"""Margin added to twice the longest planned pause: a longer standstill elsewhere means that the robot was stopped."""
_ELSEWHERE_S = 4.0
_ACCEPTED_S = 4.0
"""Standstill at the start of an unexpected program after which it is accepted; before, the operator may still move the
robot.
"""
_STEP_DEG = 0.5
"""Spacing of the points of a path. Chosen: a tenth of the distance that counts as astray."""
_AHEAD = 240
"""Number of path points searched ahead: 120 degrees of the fastest joint, more than the motion between two checks."""
_NEARLY, _LAST = 0.99, 4
"""Share of the path, or number of last points, near the end. The path of a small circle has only seventy points."""

Seen = Literal["nothing", "at_start", "driving", "ended", "stopped", "astray", "elsewhere"]
"""at_start: a program is about to start. stopped: interrupted. astray: off the path. elsewhere: at no start of a
program.
"""


@dataclass(frozen=True)
class ProgramPath:
    """Joint angles q_deg (n, 6) at equal distances, and the longest planned pause."""

    q_deg: Array
    longest_stand_s: float

    @classmethod
    def of(cls, plan: MotionPlan) -> ProgramPath:
        moves = [step for step in plan.steps if isinstance(step, Move)]
        pieces = [start_of(plan).q[None]]
        for before, move in pairwise(moves):
            pieces.append(angles_along(end_of(before), move))
        at_end = max((k for k, step in enumerate(plan.steps) if isinstance(step, Move)), default=0)
        stands = [step.seconds for step in plan.steps[:at_end] if isinstance(step, Dwell)]
        # Resample a polyline of joint angles (m, 6) to angles (n, 6) at equal distances.
        q_deg = np.degrees(np.concatenate(pieces))
        far = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(q_deg, axis=0)).max(axis=1))])
        at = np.linspace(0.0, far[-1], 2 + int(far[-1] / _STEP_DEG))
        return cls(np.stack([np.interp(at, far, joint) for joint in q_deg.T], axis=1), max(stands, default=0.0))


class ProgramWatch:
    """Waits for the expected or another known program, and follows it to the end."""

    def __init__(self, ways: Mapping[str, ProgramPath], expected: str, ended: str = "") -> None:
        """ended: previous program, at whose end the robot may still stand."""
        self._ways, self._expected, self._ended = ways, expected, ended
        self.program = ""
        """Program that is about to start or in progress."""
        self._at = 0
        self._has_moved = False
        self._first: Array | None = None
        self._stands_at: Array = np.full(6, np.inf)
        self._stands_since_s = 0.0
        self.stood_s = 0.0
        """Duration of the current standstill."""

    def reset(self) -> None:
        self._ended, self._has_moved, self._first = self.program, False, None
        self.program, self._at = "", 0

    @property
    def share(self) -> float:
        return self._at / max(1, len(self._ways[self.program].q_deg) - 1) if self.program else 0.0

    def feed(self, t_s: float, joints_deg: Sequence[float] | Array) -> Seen:
        q = np.asarray(joints_deg, dtype=float)
        if self._first is None:
            self._first = q
        self._has_moved = self._has_moved or _largest_difference(q, self._first) > NEAR_DEG
        if _largest_difference(q, self._stands_at) > FLICKER_DEG:
            self._stands_at, self._stands_since_s = q, t_s
        self.stood_s = t_s - self._stands_since_s
        if not self.program:
            return self._await(q)
        way = self._ways[self.program]
        ahead = way.q_deg[self._at : self._at + _AHEAD]
        away = np.abs(ahead - q).max(axis=1)
        if away.min() > _ASTRAY_DEG:
            return "astray"
        # Take the first near point: at a turning point of the path, the same place soon occurs again.
        self._at += int((away <= away.min() + _STEP_DEG).argmax())
        is_last = self.share >= _NEARLY or self._at > len(way.q_deg) - 1 - _LAST
        if is_last and self.stood_s >= _ENDED_S:
            return "ended"
        if self._at > 0 and self.stood_s > 2 * way.longest_stand_s + _MORE_S:
            return "stopped"
        return "driving" if self._at else "at_start"

    def _await(self, q: Array) -> Seen:
        if self.stood_s < _STANDSTILL_S:
            return "nothing"
        # Another program may start at the end of the last. If the robot did not move off, only the expected program
        # counts.
        stayed = (
            not self._has_moved and self._ended and _largest_difference(q, self._ways[self._ended].q_deg[-1]) < NEAR_DEG
        )
        is_meant = self._has_moved or (not stayed and self.stood_s > _ACCEPTED_S)
        for name in (self._expected, *(self._ways if is_meant else ())):
            if _largest_difference(q, self._ways[name].q_deg[0]) < NEAR_DEG:
                self.program, self._at = name, 0
                return "at_start"
        return "elsewhere" if self._has_moved and self.stood_s > _ELSEWHERE_S else "nothing"


def _largest_difference(first: Array, second: Array) -> float:
    return float(np.abs(first - second).max())

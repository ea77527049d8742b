"""Where the joints go and turn back, as it happens: the rule of `analysis.measures.joint_reversals`, row by row."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from analysis.kinematics.arm import Array
from analysis.live.rows import Rows
from analysis.measures.joint_reversals import PROMINENCE_RAD

_MOVES_RAD_S = float(np.radians(0.05))
"""A joint that turns more slowly stands: the noise of a feedback of 0.01° over a third of a second."""
_SPEED_S = 0.35
"""The time over which a speed is taken."""


@dataclass(frozen=True)
class JointReversal:
    """A joint (1 … 6) turned back at t_s; phi_rad: circle angle, nan off the circle; upper: from rising to falling;
    sense: of the lap, 1 for acw, -1 for cw, 0 if it is unknown."""

    axis: int
    t_s: float
    phi_rad: float
    upper: bool
    sense: int


@dataclass(frozen=True)
class JointMotion:
    """sense (6,): 1 rising, -1 falling, 0 unknown; extreme (6,) rad: the furthest in that sense, with its time
    extreme_t_s (6,) and circle angle extreme_phi (6,) rad."""

    sense: Array = field(default_factory=lambda: np.zeros(6))
    extreme: Array = field(default_factory=lambda: np.full(6, np.nan))
    extreme_t_s: Array = field(default_factory=lambda: np.full(6, np.nan))
    extreme_phi: Array = field(default_factory=lambda: np.full(6, np.nan))

    def after(self, rows: Rows, phi: Array, senses: Array) -> tuple[JointMotion, list[JointReversal]]:
        """Return the motion after rows at circle angles phi (n,) rad, and the reversals among them. senses (n,): of
        the lap."""
        sense, extreme = self.sense.copy(), self.extreme.copy()
        at_t_s, at_phi = self.extreme_t_s.copy(), self.extreme_phi.copy()
        reversals: list[JointReversal] = []
        for t_s, q, angle, lap_sense in zip(rows.t_s.tolist(), rows.q, phi.tolist(), senses.tolist(), strict=True):
            if not math.isfinite(q.sum()):
                continue
            away = q - extreme
            turned = (sense != 0) & (-sense * away > PROMINENCE_RAD)
            for axis in np.flatnonzero(turned).tolist():
                upper = bool(sense[axis] > 0)
                reversals.append(
                    JointReversal(axis + 1, float(at_t_s[axis]), float(at_phi[axis]), upper, int(lap_sense))
                )
            begins = (sense == 0) & (np.abs(away) > PROMINENCE_RAD)
            sense = np.where(turned, -sense, np.where(begins, np.sign(away), sense))
            further = np.isnan(extreme) | turned | begins | (sense * away > 0)
            extreme, at_t_s = np.where(further, q, extreme), np.where(further, t_s, at_t_s)
            at_phi = np.where(further, angle, at_phi)
        return JointMotion(sense, extreme, at_t_s, at_phi), reversals


def speeds(rows: Rows) -> Array:
    """Return the speed (6,) rad/s of each joint over the last rows; nan where it is unknown."""
    if not len(rows):
        return np.full(6, np.nan)
    recent = rows.taken(slice(int(np.searchsorted(rows.t_s, rows.t_s[-1] - _SPEED_S)) - 1, None))
    if len(recent) < 2 or recent.t_s[-1] <= recent.t_s[0]:
        return np.full(6, np.nan)
    speed: Array = (recent.q[-1] - recent.q[0]) / (recent.t_s[-1] - recent.t_s[0])
    return speed


def moves(speed_rad_s: float) -> int:
    """Return 1 for a joint that rises, -1 for one that falls and 0 for one that stands."""
    return 0 if not abs(speed_rad_s) > _MOVES_RAD_S else int(math.copysign(1, speed_rad_s))

"""The circle of the yaw and roll tests: its frame, the tool's nominal poses on it, the angle of a point.

docs/conventions.md, "Circle test": P = C + R r(phi), z_T = -r, x_T = n, y_T = z_T × x_T (the acw tangent).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from analysis.geometry.peaks import peaks
from analysis.kinematics.arm import Arm, Array
from analysis.kinematics.follow import follow
from rigs.schema.declared_tests import Circle
from rigs.schema.vocabulary import Direction

SENSE: dict[Direction, float] = {"acw": 1.0, "cw": -1.0}


@dataclass(frozen=True)
class CircleFrame:
    """centre (3,) mm; u, v, n: (3,) unit vectors, v = n × u; radius mm."""

    centre: Array
    u: Array
    v: Array
    n: Array
    radius: float

    def radial(self, phi: Array) -> Array:
        """r(phi) (k, 3) for circle angles phi (k,) rad."""
        return np.cos(phi)[:, None] * self.u + np.sin(phi)[:, None] * self.v

    def poses(self, phi: Array) -> Array:
        """Nominal T_world_tool (k, 4, 4) at circle angles phi (k,) rad."""
        r = self.radial(phi)
        T = np.zeros((len(phi), 4, 4))
        T[:, :3, 0] = self.n
        T[:, :3, 1] = np.cross(-r, self.n)
        T[:, :3, 2] = -r
        T[:, :3, 3] = self.centre + self.radius * r
        T[:, 3, 3] = 1.0
        return T

    def angle(self, points: Array) -> Array:
        """Unwrapped circle angle (k,) rad of points (k, 3) mm in the world."""
        from_centre = points - self.centre
        return np.unwrap(np.arctan2(from_centre @ self.v, from_centre @ self.u))


def circle_frame(centre: Array, normal: Array, towards: Array, radius: float) -> CircleFrame:
    """A circle about centre (3,) mm; normal (3,) of any length; phi = 0 in the direction towards (3,), projected."""
    n = normal / np.linalg.norm(normal)
    u = towards - (towards @ n) * n
    u = u / np.linalg.norm(u)
    return CircleFrame(centre, u, np.cross(n, u), n, radius)


@lru_cache(maxsize=16)
def frame_of(circle: Circle) -> CircleFrame:
    """The frame of a rig file's circle; a fit asks for that of the same few over and over."""
    return circle_frame(np.array(circle.centre_mm), np.array(circle.normal), np.array(circle.zero), circle.radius_mm)


@dataclass(frozen=True)
class Reversal:
    """A joint (1 … 6) turns back at circle angle phi (rad, 0 … 2 pi); upper: from rising to falling as phi grows."""

    axis: int
    phi: float
    upper: bool


def reversals(circle: Circle, arm: Arm, where: str) -> list[Reversal]:
    """Where the joints turn back on the nominal circle, by axis and phi (Table 1 of the paper).

    A joint that swings by less than 0.05° about the point is taken as standing. Raises FileError where the arm cannot
    follow the circle; limits of joints are those of the programs, which drive less than this does.
    """
    frame = frame_of(circle)
    # Beyond one lap at both ends, so that a turn near the start has both its flanks.
    step, first = np.radians(0.5), np.radians(circle.start_deg - circle.lead_deg)
    # The posture in which the programs begin; from there on a joint may go a turn further than they may.
    posture = follow(arm, frame.poses(np.array([first])), np.radians(circle.posture_deg), where)[0]
    unlimited = replace(arm, limits=arm.limits + 2 * np.pi * np.array([-1.0, 1.0]))
    ahead, back = first + step * np.arange(800), first - step * np.arange(1, 80)
    q_ahead = follow(unlimited, frame.poses(ahead), posture, where)
    q_back = follow(unlimited, frame.poses(back), q_ahead[0], where)
    phi, q = np.concatenate([back[::-1], ahead]), np.concatenate([q_back[::-1], q_ahead])
    turns = []
    for axis, joint in enumerate(q.T, start=1):
        for sign in (1.0, -1.0):
            for k in peaks(sign * joint, float(np.radians(0.05))):
                c = np.polyfit(phi[k - 1 : k + 2] - phi[k], joint[k - 1 : k + 2], 2)
                vertex = phi[k] - c[1] / (2 * c[0])
                if first <= vertex < first + 2 * np.pi:
                    turns.append(Reversal(axis, float(vertex % (2 * np.pi)), sign > 0))
    return sorted(turns, key=lambda turn: (turn.axis, turn.phi))

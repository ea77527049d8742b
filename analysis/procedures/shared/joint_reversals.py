"""Joint reversals on a circle: those of the nominal path, and those of a measured lap.

A measured reversal (comparable with Table 1 of the paper) counts if the joint returns by more than its noise (and
0.05°) on both sides, so encoder noise causes none; its position is the vertex of a local cubic fit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.robot.geometry.circle import peaks, reversals
from analysis.robot.geometry.driven_programs import circle_of
from analysis.robot.kinematics.arm import Array, arm_of
from analysis.runs.laps import Laps
from analysis.runs.noise.readings import noise_beneath
from rigs.rig import Rig


@dataclass(frozen=True)
class JointReversal:
    """Reversal of a joint on the nominal circle.

    joint: number of the joint, 1 to 6.
    name: name of the joint in the rig file.
    phi_deg: circle angle.
    upper: True if the joint angle changes from rising to falling with increasing circle angle.
    """

    joint: int
    name: str
    phi_deg: float
    upper: bool


def reversals_of_rig(rig: Rig) -> tuple[JointReversal, ...]:
    """Joint reversals on the nominal circle of a rig file, by circle angle.

    Raises FileError if the rig file has no circle, or the robot cannot drive it.
    """
    nominal = reversals(circle_of(rig), arm_of(rig.robot), rig.name)
    names = [axis.name for axis in rig.robot.axes]
    return tuple(
        JointReversal(turn.axis, names[turn.axis - 1], float(np.degrees(turn.phi)), turn.upper)
        for turn in sorted(nominal, key=lambda turn: turn.phi)
    )


PROMINENCE_RAD = float(np.radians(0.05))
"""Smallest joint motion that counts as a reversal."""
_NOISES = 10.0
_BEYOND = np.radians(40.0)
_NEIGHBOURHOOD = np.radians(8.0)


@dataclass(frozen=True)
class MeasuredReversal:
    """Reversal of a joint (1 … 6) at circle angle phi ± u_rad, 0 … 2 pi, in row `row` of the lap; upper: from rising to
    falling with increasing phi."""

    axis: int
    phi: float
    u_rad: float
    upper: bool
    row: int


def turns(laps: Laps) -> list[MeasuredReversal]:
    lap = laps.first
    order = np.argsort(lap.phi, kind="stable")
    phi, q = lap.phi[order], lap.q[order]
    # The closed lap is extended at both ends, so that a reversal near its start has both flanks. A joint with full
    # turns is extended by full turns.
    whole = 2 * np.pi * np.round((q[-1] - q[0]) / (2 * np.pi))
    head, tail = phi < phi[0] + _BEYOND, phi > phi[-1] - _BEYOND
    phi = np.concatenate([phi[tail] - 2 * np.pi, phi, phi[head] + 2 * np.pi])
    q, rows = np.concatenate([q[tail] - whole, q, q[head] + whole]), np.concatenate([order[tail], order, order[head]])
    seen: list[MeasuredReversal] = []
    start = float(phi[0] + _BEYOND)  # of the lap itself
    for axis, joint in enumerate(q.T, start=1):
        turned: list[MeasuredReversal] = []
        prominence = max(PROMINENCE_RAD, _NOISES * noise_beneath(joint, 0.0))
        for sign in (1.0, -1.0):
            for k in peaks(sign * joint, prominence):
                vertex, u = _vertex(phi, sign * joint, float(phi[k]))
                if not start - np.radians(1) <= vertex < start + 2 * np.pi + np.radians(1):
                    continue
                turn = MeasuredReversal(axis, vertex % (2 * np.pi), u, sign > 0, int(rows[k]))
                # A reversal at the seam of the lap is found twice.
                if all(
                    turn.upper != kept.upper or abs(angle_difference(turn.phi, kept.phi)) > np.radians(2)
                    for kept in turned
                ):
                    turned.append(turn)
        seen += turned
    return sorted(seen, key=lambda turn: (turn.axis, turn.phi))


def angle_difference(phi: float, other_phi: float) -> float:
    return float((phi - other_phi + np.pi) % (2 * np.pi) - np.pi)


def _vertex(phi: Array, joint: Array, about: float) -> tuple[float, float]:
    near = np.abs(phi - about) < _NEIGHBOURHOOD
    if near.sum() < 8:
        return about, float(np.median(np.diff(phi)))
    x = (phi[near] - about) / _NEIGHBOURHOOD
    design = np.vander(x, 4)
    c, *_ = np.linalg.lstsq(design, joint[near], rcond=None)
    residual = joint[near] - design @ c
    tops = np.roots(np.polyder(c))
    tops = np.real(tops[np.isreal(tops)])
    tops = tops[(np.polyval(np.polyder(c, 2), tops) < 0) & (np.abs(tops) <= 1)]
    if len(tops) == 0:
        return about, _NEIGHBOURHOOD / 2
    top = float(tops[np.argmin(np.abs(tops))])
    covariance = np.linalg.inv(design.T @ design) * float(residual @ residual) / max(len(x) - 4, 1)
    slope = np.array([3 * top**2, 2 * top, 1.0, 0.0])
    u = np.sqrt(slope @ covariance @ slope) / abs(np.polyval(np.polyder(c, 2), top))
    return about + top * _NEIGHBOURHOOD, float(u) * _NEIGHBOURHOOD

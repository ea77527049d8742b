"""The analysed part of a circle run: one lap from the start angle, lead-in and lead-out left away.

What the controller reported goes through the nominal kinematics; that is where the robot believed to be,
and the circle angle phi is taken from it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.circle import SENSE, CircleFrame, frame_of
from analysis.kinematics.arm import Array, arm_of, forward
from analysis.programs import circle_of
from analysis.tables import CircleTable
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.vocabulary import Direction

_RADIUS_OFF_MM = 2.0
_GAP_RAD = np.radians(5.0)


@dataclass(frozen=True)
class Lap:
    """One lap in order of time. t_s (n,), phi (n,) rad unwrapped, q (n, 6) rad, g_mm (n, k)."""

    direction: Direction
    frame: CircleFrame
    t_s: Array
    phi: Array
    q: Array
    g_mm: Array


def lap_of(table: CircleTable, rig: Rig, where: str) -> Lap:
    """The lap of a circle table; `where` names it in errors.

    Raises FileError where the robot did not drive the circle that the rig file says.
    """
    direction = table.direction
    circle = circle_of(rig)
    frame = frame_of(circle)
    tool = forward(arm_of(rig.robot), table.q)[:, :3, 3]
    phi = frame.angle(tool)
    sense = SENSE[direction]
    _is_this_circle(where, frame, tool, sense * (phi[-1] - phi[0]), direction)
    start = np.radians(circle.start_deg)
    # The first row stands at the lead-in, so the start lies less than half a turn ahead of it.
    ahead = sense * (phi - start)
    ahead -= 2 * np.pi * np.round((ahead[0] + np.radians(circle.lead_deg)) / (2 * np.pi))
    # In order of time, so that standing, or coming to the start from elsewhere, is no part of the lap.
    end = int(np.argmax(ahead >= 2 * np.pi)) or len(ahead)
    begin = int(np.flatnonzero(ahead[:end] < 0).max(initial=-1)) + 1
    inside = slice(begin, end)
    _is_covered(where, ahead[inside], sense, start)
    return Lap(
        direction,
        frame,
        table.t_s[inside],
        start + sense * ahead[inside],
        table.q[inside],
        table.g_mm[inside],
    )


def _is_this_circle(where: str, frame: CircleFrame, tool: Array, driven: float, direction: str) -> None:
    if abs(driven) > np.radians(10) and driven < 0:
        other = "acw" if direction == "cw" else "cw"
        raise FileError(where, f"is labelled {direction}, the robot moved {other}", f"record it as {other}")
    radius = float(np.median(np.linalg.norm(tool - frame.centre, axis=1)))
    height = float(np.median(np.abs((tool - frame.centre) @ frame.n)))
    if abs(radius - frame.radius) > _RADIUS_OFF_MM or height > _RADIUS_OFF_MM:
        raise FileError(
            where,
            f"the robot stayed {radius:.1f} mm from the centre and {height:.1f} mm out of the plane of the "
            f"circle in the rig file (radius {frame.radius:g} mm)",
            "correct tests.circle, robot.tool or the units of the feedback",
        )


def _is_covered(where: str, ahead: Array, sense: float, start: float) -> None:
    edges = np.concatenate([[0.0], np.sort(ahead), [2 * np.pi]])
    gaps = np.diff(edges)
    widest = int(np.argmax(gaps))
    if gaps[widest] > _GAP_RAD:
        begin, end = (np.degrees(start + sense * edges[k]) % 360 for k in (widest, widest + 1))
        raise FileError(
            where,
            f"the lap has no data from {begin:.0f}° to {end:.0f}° ({np.degrees(gaps[widest]):.0f}° wide)",
            "record the whole circle: start before the lead-in, stop after the lead-out",
        )

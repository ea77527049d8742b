"""The analysed part of a circle run: one lap from the start angle, lead-in and lead-out left away.

What the controller reported goes through the nominal kinematics; that is where the robot believed to be,
and the circle angle phi is taken from it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from analysis.kinematics.arm import Array, arm_of, forward
from analysis.model.circle import SENSE, CircleFrame, frame_of
from analysis.model.programs import circle_of
from analysis.reading.tables import CircleTable
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.vocabulary import Direction

_RADIUS_OFF_MM = 2.0
_AWAY_S = 0.1
"""The tool was away from the circle, and not a row or two of the feedback wrong, if it was so for this long."""
_GAP_RAD = np.radians(5.0)
_MORE_LAPS = 0.9
"""A lead-out is never so long (of a lap): what goes on further is another lap."""
_STANDING_RAD = np.radians(0.2)
_JUMP_RAD = np.radians(1.0)
_JUMP_SPEEDS = 3.0
"""Between two rows a joint moves no further than this many times its greatest speed, and _JUMP_RAD, allow."""


@dataclass(frozen=True)
class Lap:
    """One lap in order of time. t_s (n,), phi (n,) rad unwrapped, q (n, 6) rad, g_mm (n, k); notes: what a person
    should know of how it was cut out; u_t_s (n,) as in the table."""

    direction: Direction
    frame: CircleFrame
    t_s: Array
    phi: Array
    q: Array
    g_mm: Array
    notes: tuple[str, ...] = ()
    u_t_s: Array | None = None


def lap_of(table: CircleTable, rig: Rig, where: str) -> Lap:
    """The lap of a circle table, the first where more were driven; `where` names it in errors.

    Raises FileError where the robot did not drive the circle that the rig file says.
    """
    direction = table.direction
    circle = circle_of(rig)
    _is_motion(where, table, rig)
    frame = frame_of(circle)
    tool = forward(arm_of(rig.robot), table.q)[:, :3, 3]
    sense = SENSE[direction]
    phi = frame.angle(tool)
    stretches = _on_circle(table.t_s, tool, frame)
    turned = [abs(float(phi[rows][-1] - phi[rows][0])) for rows in stretches]
    if max(turned, default=0.0) < np.pi:
        _is_this_circle(where, frame, tool, bool(stretches))
    first = next(k for k, far in enumerate(turned) if far >= _MORE_LAPS * max(turned))
    table, phi = _rows_of(table, stretches[first]), phi[stretches[first]]
    _is_this_direction(where, sense * (phi[-1] - phi[0]), direction)
    start = np.radians(circle.start_deg)
    # The first row stands at the lead-in, so the start lies less than half a turn ahead of it.
    ahead = sense * (phi - start)
    ahead -= 2 * np.pi * np.round((ahead[0] + np.radians(circle.lead_deg)) / (2 * np.pi))
    # In order of time, so that standing, or coming to the start from elsewhere, is no part of the lap.
    end = int(np.argmax(ahead >= 2 * np.pi)) or len(ahead)
    begin = int(np.flatnonzero(ahead[:end] < 0).max(initial=-1)) + 1
    inside = slice(begin, end)
    _is_steady(where, table.t_s[inside], table.q[inside], rig)
    _is_covered(where, ahead[inside], sense, start)
    return Lap(
        direction,
        frame,
        table.t_s[inside],
        start + sense * ahead[inside],
        table.q[inside],
        table.g_mm[inside],
        _more_laps(ahead.max() + sum(turned) - turned[first]),
        None if table.u_t_s is None else table.u_t_s[inside],
    )


def _on_circle(t_s: Array, tool: Array, frame: CircleFrame) -> list[slice]:
    """Rows (n,) while the tool (n, 3) was on the circle, stretch by stretch: not on the way to it or from it, where it
    may pass any angle. A row or two that jump off belong to their stretch, and are found there."""
    radius, height = np.linalg.norm(tool - frame.centre, axis=1), (tool - frame.centre) @ frame.n
    rows = np.flatnonzero(np.maximum(np.abs(radius - frame.radius), np.abs(height)) <= _RADIUS_OFF_MM)
    if not len(rows):
        return []
    left = np.flatnonzero((np.diff(rows) > 1) & (np.diff(t_s[rows]) > _AWAY_S))
    begins, ends = np.append(rows[0], rows[left + 1]), np.append(rows[left], rows[-1])
    return [slice(begin, end + 1) for begin, end in zip(begins.tolist(), ends.tolist(), strict=True)]


def _rows_of(table: CircleTable, rows: slice) -> CircleTable:
    u_t_s = None if table.u_t_s is None else table.u_t_s[rows]
    return replace(table, t_s=table.t_s[rows], q=table.q[rows], g_mm=table.g_mm[rows], u_t_s=u_t_s)


def _more_laps(turned: float) -> tuple[str, ...]:
    laps = turned / (2 * np.pi)
    if laps < 1 + _MORE_LAPS:
        return ()
    return (f"the robot drove {laps:.1f} laps in one run: the first is evaluated",)


def _is_motion(where: str, table: CircleTable, rig: Rig) -> None:
    """Raises FileError for angles that no robot runs through: none at all, or no numbers."""
    if len(table.q) < 2:
        raise FileError(where, f"has {len(table.q)} rows, which is no circle", "record the whole circle")
    if not np.isfinite(table.q).all():
        row = int(np.argmin(np.isfinite(table.q).all(axis=1))) + 1
        raise FileError(where, f"row {row} has a joint angle that is no number", "leave such rows out")
    if np.ptp(table.q, axis=0).max() < _STANDING_RAD:
        raise FileError(where, "the robot stood still", "start the circle program once the recording runs")


def _is_steady(where: str, t_s: Array, q: Array, rig: Rig) -> None:
    """Raises FileError where a joint jumps further than it can run."""
    speed = np.radians([axis.speed_deg_s for axis in rig.robot.axes])
    step = np.abs(np.diff(q, axis=0))
    over = step > _JUMP_RAD + _JUMP_SPEEDS * speed * np.abs(np.diff(t_s))[:, None]
    if over.any():
        row, axis = (int(k) for k in np.argwhere(over)[0])
        raise FileError(
            where,
            f"{rig.robot.axes[axis].name} jumps by {np.degrees(step[row, axis]):.1f}° at {t_s[row + 1]:.3f} s",
            "see the feedback's units and wrap-around, or leave the bad rows out",
        )


def _is_this_direction(where: str, driven: float, direction: str) -> None:
    if abs(driven) > np.radians(10) and driven < 0:
        other = "acw" if direction == "cw" else "cw"
        raise FileError(
            where,
            f"is labelled {direction}, the robot moved {other}",
            f"correct it: rig relabel RUN --direction {other}",
        )


def _is_this_circle(where: str, frame: CircleFrame, tool: Array, ever: bool) -> None:
    radius = float(np.median(np.linalg.norm(tool - frame.centre, axis=1)))
    height = float(np.median(np.abs((tool - frame.centre) @ frame.n)))
    if not ever or abs(radius - frame.radius) > _RADIUS_OFF_MM or height > _RADIUS_OFF_MM:
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
            "record the whole circle, from before the lead-in to after the lead-out, on a computer with time to spare",
        )

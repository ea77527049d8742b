"""Whole laps of a circle run from the start angle, without lead-in and lead-out.

The circle angle phi is computed from the reported joint angles by nominal kinematics, the position assumed by the
robot.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from weakref import ref

import numpy as np

from analysis.robot.geometry.circle import SENSE, CircleFrame, frame_of
from analysis.robot.geometry.driven_programs import circle_of
from analysis.robot.kinematics.arm import Arm, Array, Integers, Mask, arm_of, forward
from analysis.runs.noise.readings import rms
from analysis.runs.stands import STOOD_RAD
from analysis.runs.tables import CircleTable
from rigs.errors import DirectionError, FileError
from rigs.rig import Rig
from rigs.schema.declared_tests import Circle
from rigs.schema.robot import Robot
from rigs.schema.vocabulary import Direction
from rigs.text import as_argument

_RADIUS_OFF_MM = 2.0
_AWAY_S = 0.1
"""Minimum time away from the circle; shorter deviations are wrong rows of the feedback."""
_GAP_RAD, _WIDEST_RAD = np.radians(5.0), np.radians(10.0)
_STEPS = 4.0
"""Permitted gaps in a lap: 5°, or for a slow gauge this number of its steps, up to 10°."""
_TURNS_BACK_RAD = np.radians(20.0)
"""Smaller reversals are feedback noise, or a program locating its start."""
_SEEN = 4000
"""Rows for detecting reversals and standstills."""
_COVER = 40_000
"""Rows for detecting gaps in a lap, closer than a hundredth of a degree."""
_REPORTS_S = 0.002
"""Shortest reporting interval of controllers: 2 ms (RTDE of the e-Series); gauges may be faster."""
_BLOCK = 4096
"""Rows per block of poses, to limit the memory of a long run."""
_HARDLY = 0.01
"""A run that ends by less than this share before the full lap counts as complete; a wider gap would be refused
anyway."""
_JUMP_RAD = np.radians(1.0)
_JUMP_SPEEDS = 3.0
"""Limit of joint motion between two rows: this multiple of the maximum speed, plus _JUMP_RAD."""


@dataclass(frozen=True)
class Laps:
    """Whole laps in order of time.

    t_s (n,), q (n, 6) rad, g_mm (n, k). phi (n,) rad: continuous from lap to lap, whatever happened in between. notes:
    about the selection. count: number of laps. lap_s: mean duration. apart_s: time between the starts of laps. u_t_s:
    rms of the individual time uncertainties.
    """

    direction: Direction
    frame: CircleFrame
    t_s: Array
    phi: Array
    q: Array
    g_mm: Array
    lap_s: float
    apart_s: float
    count: int = 1
    u_t_s: float = 0.0
    notes: tuple[str, ...] = ()

    @property
    def first(self) -> Laps:
        """Return the first lap."""
        rows = np.abs(self.phi - self.start) < 2 * np.pi
        return replace(self, count=1, **{name: getattr(self, name)[rows] for name in ("t_s", "phi", "q", "g_mm")})

    @property
    def without_rows(self) -> Laps:
        """Return the laps with a copy of their first row only."""
        rows = {name: getattr(self, name)[:1].copy() for name in ("t_s", "phi", "q", "g_mm")}
        return replace(self, **rows)

    @property
    def start(self) -> float:
        """Circle angle, rad, of the lap start, to the nearest row."""
        return float(self.phi[0])


def laps_of(table: CircleTable, rig: Rig, where: str) -> Laps:
    """Return all whole laps of a circle table in its direction; `where` names the run in errors.

    Laps may be consecutive, or have returns in between, because few wrists have two spare turns. Laps of short tables
    are cached with the table, for all parts of a diagnosis, others as long as they are referenced. Raises FileError if
    the robot did not drive the circle of the rig file.
    """
    key, cell = id(table), (rig.robot, rig.tests.circle)
    if (kept := _LAPS.get(key)) is not None and kept[0]() is table and kept[1] == cell and (laps := kept[2]()):
        return laps
    if len(table.q) < 2:
        raise FileError(where, f"has {len(table.q)} rows, too few for a circle", "record the whole circle")
    if not np.isfinite(table.q).all():
        row = int(np.argmin(np.isfinite(table.q).all(axis=1))) + 1
        raise FileError(where, f"row {row} has a joint angle that is not a number", "remove such rows")
    if np.ptp(table.q[:: max(1, len(table.q) // _SEEN)], axis=0).max() < STOOD_RAD:
        raise FileError(where, "the robot stood still", "start the recording first, then the circle program")
    laps = _cut_out(table, rig, where)
    asked: Callable[[], Laps | None] = ref(laps) if len(table.q) > _KEPT_ROWS else lambda: laps
    _LAPS[key] = (ref(table, lambda _: _LAPS.pop(key, None)), cell, asked)
    return laps


_LAPS: dict[int, tuple[ref[CircleTable], tuple[Robot, Circle | None], Callable[[], Laps | None]]] = {}
"""Cached laps by the identity of the table, with the arm and circle."""
_KEPT_ROWS = 50_000
"""Rows above which a copy needs more than 5 MB."""


def _cut_out(table: CircleTable, rig: Rig, where: str) -> Laps:
    """Return the laps of a table. Raises FileError."""
    circle = circle_of(rig)
    frame, sense = frame_of(circle), SENSE[table.direction]
    start, lead = np.radians(circle.start_deg), np.radians(circle.lead_deg)
    ways = _ways_along(frame, start, table, rig, where)
    laps = []
    for rows, ahead in ways:
        if ahead[-1] > ahead[0]:
            first = _turns_before(ahead, lead)
            count = int((ahead.max() - first) / (2 * np.pi) + _HARDLY)
            laps += [_lap_from(rows, ahead, first + 2 * np.pi * lap) for lap in range(count)]
    if not laps:
        rows, ahead = max(ways, key=lambda way: float(way[1][-1] - way[1][0]))
        laps = [_lap_from(rows, ahead, _turns_before(ahead, lead))]
    for _, ahead in laps:
        _require_covered(where, ahead, sense, start)
    # A view is sufficient for a single lap, which may be long.
    inside = laps[0][0] if len(laps) == 1 else np.concatenate([np.arange(rows.start, rows.stop) for rows, _ in laps])
    begins = np.array([table.t_s[rows.start] for rows, _ in laps])
    lap_s = float(np.mean([table.t_s[rows.stop - 1] - table.t_s[rows.start] for rows, _ in laps]))
    apart_s = float(np.diff(begins).mean()) if len(laps) > 1 else lap_s
    phi = start + sense * np.concatenate([2 * np.pi * k + ahead for k, (_, ahead) in enumerate(laps)])
    u_t_s, rows_of_laps = table.u_t_s, (phi, table.q[inside], table.g_mm[inside])
    u_s = 0.0 if u_t_s is None else rms(u_t_s[inside])
    return Laps(table.direction, frame, table.t_s[inside], *rows_of_laps, lap_s, apart_s, len(laps), u_s)


def _ways_along(
    frame: CircleFrame, start: float, table: CircleTable, rig: Rig, where: str
) -> list[tuple[slice, Array]]:
    """Return the rows of each motion along a circle, and their angles, rad, after its start in the direction of the
    table.

    Raises FileError if the robot drove a different circle, DirectionError for the opposite direction.
    """
    # No closer than a controller reports: rows in between are interpolated.
    step = max(1, int(_REPORTS_S / max(float(np.median(np.diff(table.t_s[:_SEEN]))), 1e-9)))
    rows_seen = np.append(np.arange(0, len(table.t_s) - 1, step), len(table.t_s) - 1)
    tool = places_along(arm_of(rig.robot), table.q, rows_seen)
    phi = frame.angle(tool)
    stretches = _on_circle(table.t_s, tool, frame, rows_seen)
    if len(rows_seen) < len(table.q):
        phi = np.interp(np.arange(len(table.q)), rows_seen, phi)
    turned = [float(np.ptp(phi[rows])) for rows in stretches]
    if max(turned, default=0.0) < np.pi:
        _require_this_circle(where, frame, tool, bool(stretches))
    ways: list[tuple[slice, Array]] = []
    for stretch in stretches:
        rows = _without_leaps(where, table, phi, stretch, rig)
        ahead = SENSE[table.direction] * (phi[rows] - start)
        # A motion begins at the lead-in, so the start is less than half a turn ahead.
        ways += [(slice(rows.start + a, rows.start + b), ahead[a:b]) for a, b in _ways(ahead)]
    # A robot that drives a lap and returns completely, to unwind its wrist, moves equally in both directions: the label
    # decides.
    forth, back = (sum(max(sign * float(way[-1] - way[0]), 0.0) for _, way in ways) for sign in (1.0, -1.0))
    if back > forth + np.radians(10):
        drove: Direction = "acw" if table.direction == "cw" else "cw"
        relabel = f"rig relabel {as_argument(where)} --direction {drove}"
        remedy = f"correct it: {relabel}, or import the table again without a direction column"
        raise DirectionError(where, f"is labelled {table.direction}, the robot moved {drove}", remedy, drove)
    return ways


def is_on_circle(tool: Array, frame: CircleFrame) -> Mask:
    """Return a mask (n,) of tool positions (n, 3) mm on the circle, within the accuracy of a program."""
    from_centre = tool - frame.centre
    radius, height = np.linalg.norm(from_centre, axis=1), from_centre @ frame.n
    return np.asarray(np.maximum(np.abs(radius - frame.radius), np.abs(height)) <= _RADIUS_OFF_MM)


def _ways(ahead: Array) -> list[tuple[int, int]]:
    """Return the rows (begin, end) of each motion between reversals along circle angles (n,)."""
    step = max(1, len(ahead) // _SEEN)
    turns, extreme, sense = [0], 0, 0.0
    for row in range(0, len(ahead), step):
        away = ahead[row] - ahead[extreme]
        if sense == 0.0:
            sense = float(np.sign(away)) if abs(away) > _TURNS_BACK_RAD else 0.0
            extreme = row if sense else extreme
        elif sense * away > 0:
            extreme = row
        elif -sense * away > _TURNS_BACK_RAD:
            turns.append(extreme)
            sense, extreme = -sense, row
    return list(pairwise([*turns, len(ahead)]))


def _turns_before(ahead: Array, lead: float) -> float:
    """Return the circle angle, a multiple of whole turns, at which the first lap of a motion (n,) begins.

    The first row is at the lead-in, or at the start itself.
    """
    return float(2 * np.pi * np.round((ahead[0] + lead) / (2 * np.pi)))


def _lap_from(rows: slice, ahead: Array, begins: float) -> tuple[slice, Array]:
    """Return the rows of the lap beginning at a circle angle, and its circle angles from 0.

    In order of time, so a standstill or an approach to the start is not included.
    """
    since = ahead - begins
    end = int(np.argmax(since >= 2 * np.pi)) or len(since)
    begin = int(np.flatnonzero(since[:end] < 0).max(initial=-1)) + 1
    return slice(rows.start + begin, rows.start + end), since[begin:end]


def places_along(arm: Arm, q: Array, rows: Integers) -> Array:
    """Return tool positions (m, 3) mm in some rows (m,) of joint angles (n, 6) rad."""
    places = np.empty((len(rows), 3))
    for begin in range(0, len(rows), _BLOCK):
        places[begin : begin + _BLOCK] = forward(arm, q[rows[begin : begin + _BLOCK]])[:, :3, 3]
    return places


def _on_circle(t_s: Array, tool: Array, frame: CircleFrame, seen: Integers) -> list[slice]:
    """Return the rows (n,) of each stay on the circle, for tool positions (m, 3) mm in rows seen (m,).

    Approach and departure, which may have any angle, are excluded. One or two rows off the circle belong to their stay,
    and are detected later.
    """
    on = np.flatnonzero(is_on_circle(tool, frame))
    if not len(on):
        return []
    rows = seen[on]
    away = np.flatnonzero((np.diff(on) > 1) & (np.diff(t_s[rows]) > _AWAY_S))
    begins, ends = np.append(rows[0], rows[away + 1]), np.append(rows[away], rows[-1])
    return [slice(begin, end + 1) for begin, end in zip(begins.tolist(), ends.tolist(), strict=True)]


def _without_leaps(where: str, table: CircleTable, phi: Array, rows: slice, rig: Rig) -> slice:
    """Return a section without the part before or after a jump at standstill, where the robot was set to a start.

    Raises FileError if a joint jumps by more than its speed permits in the middle of the circle.
    """
    t_s, q = table.t_s[rows], table.q[rows]
    begin, end = 0, len(q)
    for row, axis, step in leaps_of(t_s, q, rig):
        before, after = phi[rows.start + begin : rows.start + row + 1], phi[rows.start + row + 1 : rows.stop]
        if row < begin:
            continue
        if np.ptp(before) < _TURNS_BACK_RAD:
            begin = row + 1
        elif np.ptp(after) < _TURNS_BACK_RAD:
            end = row + 1
            break
        else:
            jump = f"{rig.robot.axis_words(axis + 1)} jumps by {np.degrees(step):.1f}° at {t_s[row + 1]:.3f} s"
            raise FileError(where, jump, "check the feedback's units and wrap-around, or remove the bad rows")
    return slice(rows.start + begin, rows.start + end)


def leaps_of(t_s: Array, q: Array, rig: Rig) -> list[tuple[int, int, float]]:
    """Return row before, axis and size, rad, of each step between rows of q (n, 6) rad at t_s (n,) s beyond the joint
    speeds.

    Computed axis by axis, because a run may be long.
    """
    leaps = []
    for axis, joint in enumerate(q.T):
        step = np.abs(np.diff(joint))
        if step.max(initial=0.0) > _JUMP_RAD:
            run_rad = np.radians(rig.robot.axes[axis].speed_deg_s) * np.abs(np.diff(t_s))
            over = np.flatnonzero(step > _JUMP_RAD + _JUMP_SPEEDS * run_rad)
            leaps += [(row, axis, float(step[row])) for row in over.tolist()]
    return sorted(leaps)


def _require_this_circle(where: str, frame: CircleFrame, tool: Array, ever: bool) -> None:
    radius = float(np.median(np.linalg.norm(tool - frame.centre, axis=1)))
    height = float(np.median(np.abs((tool - frame.centre) @ frame.n)))
    if not ever or abs(radius - frame.radius) > _RADIUS_OFF_MM or height > _RADIUS_OFF_MM:
        problem = (
            f"the robot stayed {radius:.1f} mm from the centre and {height:.1f} mm out of the plane of the "
            f"circle in the rig file (radius {frame.radius:g} mm)"
        )
        raise FileError(where, problem, "correct tests.circle, robot.tool or the units of the feedback")


def _require_covered(where: str, ahead: Array, sense: float, start: float) -> None:
    edges = np.concatenate([[0.0], np.sort(ahead[:: max(1, len(ahead) // _COVER)]), [2 * np.pi]])
    gaps = np.diff(edges)
    widest = int(np.argmax(gaps))
    if gaps[widest] > max(_GAP_RAD, min(_STEPS * float(np.median(gaps)), _WIDEST_RAD)):
        begin, end = (np.degrees(start + sense * edges[k]) % 360 for k in (widest, widest + 1))
        problem = f"the lap has no data from {begin:.0f}° to {end:.0f}° ({np.degrees(gaps[widest]):.0f}° wide)"
        remedy = (
            "record the whole circle, from before the lead-in to after the lead-out, on a computer that is less busy"
        )
        raise FileError(where, problem, remedy)

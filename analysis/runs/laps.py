"""Complete laps of a circle run. The circle angle phi follows from the reported joint angles by nominal kinematics."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from analysis.robot.geometry.circle import SENSE, CircleFrame, frame_of
from analysis.robot.geometry.driven_programs import circle_of
from analysis.robot.kinematics.arm import Array, Integers, Mask, arm_of, forward
from analysis.runs.noise.readings import rms
from analysis.runs.stands import STILL_RUN_RAD
from analysis.runs.tables import CircleTable
from rigs.errors import DirectionError, FileError
from rigs.rig import Rig
from rigs.schema.vocabulary import Direction
from rigs.text import as_argument

_RADIUS_OFF_MM = 2.0
_SHORTEST_ABSENCE_S = 0.1
"""Shortest time away from the circle. Shorter deviations are faulty rows of the feedback."""
_GAP_RAD, _WIDEST_RAD = np.radians(5.0), np.radians(10.0)
_STEPS = 4.0
"""Largest gap in a lap: 5°, or for a slow gauge this number of steps, up to 10°."""
_TURNS_BACK_RAD = np.radians(20.0)
"""Smallest reversal of the direction. Smaller ones are feedback noise, or a program moving to the start."""
_SEEN = 4000
"""Number of rows used to detect reversals and standstills."""
_COVER = 40_000
"""Number of rows used to detect gaps in a lap; they are less than a hundredth of a degree apart."""
_REPORTS_S = 0.002
"""Shortest reporting interval of controllers: 2 ms (RTDE of the e-Series). Gauges may be faster."""
_MISSING_SHARE = 0.01
"""Share of a lap that may be missing at the end. A wider gap would be refused in any case."""
_JUMP_RAD = np.radians(1.0)
_JUMP_SPEEDS = 3.0
"""Limit of joint motion between two rows: this multiple of the maximum speed, plus _JUMP_RAD."""


@dataclass(frozen=True)
class Laps:
    """Complete laps in order of time, with phi continuous from lap to lap.

    apart_s: time between the starts of laps. u_t_s: rms of the individual time uncertainties.
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
        rows = np.abs(self.phi - self.start) < 2 * np.pi
        return replace(self, count=1, **{name: getattr(self, name)[rows] for name in ("t_s", "phi", "q", "g_mm")})

    @property
    def without_rows(self) -> Laps:
        rows = {name: getattr(self, name)[:1].copy() for name in ("t_s", "phi", "q", "g_mm")}
        return replace(self, **rows)

    @property
    def start(self) -> float:
        return float(self.phi[0])


def laps_of(table: CircleTable, rig: Rig, where: str) -> Laps:
    """All complete laps of a circle table in its direction, kept with the table for all parts of a diagnosis.

    Laps are consecutive, or separated by returns, because few wrists have two spare turns. Raises FileError if the
    robot did not drive the circle of the rig file.
    """
    cell = (rig.robot, rig.tests.circle)
    kept: tuple[object, Laps] | None = vars(table).get("_laps")
    if kept is not None and kept[0] == cell:
        return kept[1]
    if len(table.q) < 2:
        raise FileError(
            where, f"has {len(table.q)} rows, too few for a circle", "record the whole circle", code="readings.too_few"
        )
    if not np.isfinite(table.q).all():
        row = int(np.argmin(np.isfinite(table.q).all(axis=1))) + 1
        raise FileError(
            where, f"row {row} has a joint angle that is not a number", "remove such rows", code="table.invalid"
        )
    if np.ptp(table.q[:: max(1, len(table.q) // _SEEN)], axis=0).max() < STILL_RUN_RAD:
        raise FileError(
            where, "the robot stood still", "start the recording before the circle program", code="readings.unsuitable"
        )
    laps = _cut_out(table, rig, where)
    vars(table)["_laps"] = (cell, laps)
    return laps


def _cut_out(table: CircleTable, rig: Rig, where: str) -> Laps:
    circle = circle_of(rig)
    frame, sense = frame_of(circle), SENSE[table.direction]
    start, lead = np.radians(circle.start_deg), np.radians(circle.lead_deg)
    ways = _ways_along(frame, start, table, rig, where)
    laps = []
    for rows, ahead in ways:
        if ahead[-1] > ahead[0]:
            first = _turns_before(ahead, lead)
            count = int((ahead.max() - first) / (2 * np.pi) + _MISSING_SHARE)
            laps += [_lap_from(rows, ahead, first + 2 * np.pi * lap) for lap in range(count)]
    if not laps:
        rows, ahead = max(ways, key=lambda way: float(way[1][-1] - way[1][0]))
        laps = [_lap_from(rows, ahead, _turns_before(ahead, lead))]
    for _, ahead in laps:
        _require_covered(where, ahead, sense, start)
    # For a single lap, which may be long, a view is sufficient.
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
    """Rows of each motion along the circle, with angles in rad from the start in the direction of the table.

    Raises FileError for a different circle, and DirectionError for the opposite direction.
    """
    # Compute poses at the reporting rate of controllers. Rows in between are interpolated.
    step = max(1, int(_REPORTS_S / max(float(np.median(np.diff(table.t_s[:_SEEN]))), 1e-9)))
    rows_seen = np.append(np.arange(0, len(table.t_s) - 1, step), len(table.t_s) - 1)
    tool = forward(arm_of(rig.robot), table.q[rows_seen])[:, :3, 3].copy()
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
        # A motion starts at the lead-in, so the start of the lap is less than half a turn ahead.
        ways += [(slice(rows.start + a, rows.start + b), ahead[a:b]) for a, b in _ways(ahead)]
    # A robot that drives a lap and returns completely, to unwind its wrist, moves equally in both directions. In this
    # case the label is correct.
    forth, back = (sum(max(sign * float(way[-1] - way[0]), 0.0) for _, way in ways) for sign in (1.0, -1.0))
    if back > forth + np.radians(10):
        drove: Direction = "acw" if table.direction == "cw" else "cw"
        relabel = f"rig relabel {as_argument(where)} --direction {drove}"
        remedy = f"correct the label: {relabel}, or import the table without a direction column"
        raise DirectionError(where, f"is labelled {table.direction}, but the robot moved {drove}", remedy, drove)
    return ways


def is_on_circle(tool: Array, frame: CircleFrame) -> Mask:
    from_centre = tool - frame.centre
    radius, height = np.linalg.norm(from_centre, axis=1), from_centre @ frame.n
    return np.asarray(np.maximum(np.abs(radius - frame.radius), np.abs(height)) <= _RADIUS_OFF_MM)


def _ways(ahead: Array) -> list[tuple[int, int]]:
    """Rows (begin, end) between reversals of the circle angle (n,) rad."""
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
    """Circle angle, in whole turns, of the first lap; the first row is at the lead-in, or at the start itself."""
    return float(2 * np.pi * np.round((ahead[0] + lead) / (2 * np.pi)))


def _lap_from(rows: slice, ahead: Array, begins: float) -> tuple[slice, Array]:
    """Rows of the lap that begins at a circle angle, with angles (n,) rad from 0, without standstill or approach."""
    since = ahead - begins
    end = int(np.argmax(since >= 2 * np.pi)) or len(since)
    begin = int(np.flatnonzero(since[:end] < 0).max(initial=-1)) + 1
    return slice(rows.start + begin, rows.start + end), since[begin:end]


def _on_circle(t_s: Array, tool: Array, frame: CircleFrame, seen: Integers) -> list[slice]:
    """Rows of each stay on the circle.

    Approach and departure, which may be at any angle, are excluded. One or two faulty rows do not interrupt a stay;
    they are detected later.
    """
    on = np.flatnonzero(is_on_circle(tool, frame))
    if not len(on):
        return []
    rows = seen[on]
    away = np.flatnonzero((np.diff(on) > 1) & (np.diff(t_s[rows]) > _SHORTEST_ABSENCE_S))
    begins, ends = np.append(rows[0], rows[away + 1]), np.append(rows[away], rows[-1])
    return [slice(begin, end + 1) for begin, end in zip(begins.tolist(), ends.tolist(), strict=True)]


def _without_leaps(where: str, table: CircleTable, phi: Array, rows: slice, rig: Rig) -> slice:
    """Cut off the part before or after a jump at standstill, as caused by a move to a start.

    Raises FileError if a joint jumps in the middle of the circle.
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
            raise FileError(
                where,
                jump,
                "check the feedback's units and wrap-around, or remove the bad rows",
                code="readings.unsuitable",
            )
    return slice(rows.start + begin, rows.start + end)


def leaps_of(t_s: Array, q: Array, rig: Rig) -> list[tuple[int, int, float]]:
    """Steps that exceed the joint speeds: the row before, the axis, and the size in rad."""
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
        raise FileError(
            where, problem, "correct tests.circle, robot.tool or the units of the feedback", code="readings.unsuitable"
        )


def _require_covered(where: str, ahead: Array, sense: float, start: float) -> None:
    edges = np.concatenate([[0.0], np.sort(ahead[:: max(1, len(ahead) // _COVER)]), [2 * np.pi]])
    gaps = np.diff(edges)
    widest = int(np.argmax(gaps))
    if gaps[widest] > max(_GAP_RAD, min(_STEPS * float(np.median(gaps)), _WIDEST_RAD)):
        begin, end = (np.degrees(start + sense * edges[k]) % 360 for k in (widest, widest + 1))
        problem = f"the lap has no data from {begin:.0f}° to {end:.0f}° ({np.degrees(gaps[widest]):.0f}° wide)"
        remedy = "record the complete circle, including lead-in and lead-out, on a less busy computer"
        raise FileError(where, problem, remedy, code="readings.unsuitable")

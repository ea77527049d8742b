"""Whether a table was measured where and as fast as its rig file says: certain mistakes refused, doubts in words.

By the nominal arm: it errs by some mm, and a cell is seldom where its file says to much better than 20 mm.
"""

from __future__ import annotations

import numpy as np

from analysis.geometry.circle import frame_of
from analysis.geometry.hemisphere import hemisphere_frame, target_angles
from analysis.kinematics.arm import Array, arm_of, forward
from analysis.traces.tables import CircleTable, PoseTable, RadialTable, RepeatabilityTable, Table
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.declared_tests import Circle, Hemisphere

_NEAR_MM = 20.0
_ROWS = 5000
"""So many rows are enough to see how fast a circle was driven."""
_UNITS_S = {"ms": 1e-3, "µs": 1e-6, "ns": 1e-9}
_OFF = 3.2
"""A speed within so many times of a unit's is taken as off by that unit: a circle is never driven at such a speed."""


def hold_targets(table: Table, rig: Rig, where: str) -> None:
    """Raises FileError for a target number that the rig's hemisphere does not have."""
    if rig.tests.hemisphere is None or not isinstance(table, RadialTable | RepeatabilityTable):
        return
    count = target_count(rig.tests.hemisphere)
    unknown = (table.target < 1) | (table.target > count)
    if unknown.any():
        row = int(np.argmax(unknown))
        what = f"target {table.target[row]} of row {row + 1} is not one of the {count} of the hemisphere"
        raise FileError(where, what, "correct target, or tests.hemisphere in the rig file")


def target_count(hemisphere: Hemisphere) -> int:
    """How many targets a hemisphere has."""
    return len(target_angles(hemisphere)[0])


def doubts_of(table: Table, rig: Rig) -> tuple[str, ...]:
    """What is doubtful about place and speed, in words. Its target numbers are known to the rig."""
    match table:
        case CircleTable():
            return _speed(table, rig, rig.tests.circle) if rig.tests.circle else ()
        case RadialTable() | RepeatabilityTable():
            return _away(table, rig, rig.tests.hemisphere) if rig.tests.hemisphere else ()
        case PoseTable():
            return ()


def _speed(table: CircleTable, rig: Rig, circle: Circle) -> tuple[str, ...]:
    """Whether the mean speed along the circle is off by a unit."""
    some = slice(None, None, max(1, len(table.q) // _ROWS))
    phi = frame_of(circle).angle(forward(arm_of(rig.robot), table.q[some])[:, :3, 3])
    seconds = float(np.ptp(table.t_s))
    if seconds == 0:
        return ()
    driven_rad = float(np.abs(np.diff(np.unwrap(phi))).sum())  # laps and the ways back between them
    share = driven_rad * circle.radius_mm / seconds / circle.speed_mm_s
    fact = f"the circle was driven at {share:.2g} times the speed_mm_s of the rig file"
    for unit, unit_s in _UNITS_S.items():
        if 1 / _OFF < share / unit_s < _OFF:
            return (f"{fact}: t_s may be in {unit}",)
        if 1 / _OFF < share * unit_s < _OFF:
            return (f"{fact}: check the units of t_s and speed_mm_s",)
    return ()


def _away(table: RadialTable | RepeatabilityTable, rig: Rig, hemisphere: Hemisphere) -> tuple[str, ...]:
    """The first reading that the nominal arm takes elsewhere than to its target."""
    frame = hemisphere_frame(hemisphere)
    places = frame.centre + frame.radius * frame.direction(*_angles(table, hemisphere))
    away = np.linalg.norm(forward(arm_of(rig.robot), table.q)[:, :3, 3] - places, axis=1)
    far = away > _NEAR_MM
    if not far.any():
        return ()
    row = int(np.argmax(far))
    fact = f"by the nominal arm the tool was {away[row]:.0f} mm from target {table.target[row]} in row {row + 1}"
    return (
        f"{fact}, and further than {_NEAR_MM:g} mm in {far.sum()} of {len(far)} rows; check target, angles, joints",
    )


def _angles(table: RadialTable | RepeatabilityTable, hemisphere: Hemisphere) -> tuple[Array, Array]:
    """Polar angle and azimuth (n,) rad of each row: as the table gives them, or those of its target's number."""
    if isinstance(table, RadialTable):
        return table.polar, table.azimuth
    polar, azimuth = target_angles(hemisphere)
    return polar[table.target - 1], azimuth[table.target - 1]

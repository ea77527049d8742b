"""Units and labels taken by mistake, where the rig and the data together prove it.

Nothing here is a matter of taste: a claim needs data that are impossible as labelled and right as claimed.
What is only unlikely is a doubt; what cannot be detected is accepted.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from analysis.files.gauge_units import circle_gauges, too_far
from analysis.files.off_path import off_path
from analysis.files.tracker_units import tracker, tracker_doubts
from analysis.kinematics.arm import Array, arm_of, forward
from analysis.measures.rig_agreement import doubts_of
from analysis.traces.tables import CircleTable, PoseTable, RadialTable, RepeatabilityTable, Table
from rigs.errors import FileError
from rigs.rig import Rig

_TURN_RAD = 2 * np.pi + 0.1
_CLEARLY = 3.0
"""One way to read the joints is right and the other wrong where it is off the path by this factor more."""
_UNLIKELY = 0.1
"""A robot that stops on a sphere of this share of its travel has shown its gauge more than its errors."""


def check_units(table: Table, rig: Rig, where: str) -> list[str]:
    """What is doubtful, in words; `where` names the table. Raises FileError for the first mistake that is certain."""
    arm = arm_of(rig.robot)
    places = forward(arm, table.q)
    if _radians(table, rig, places, forward(arm, np.degrees(table.q))):
        what = "q1_deg … q6_deg are radians: only then does the robot of the rig file follow the program"
        raise FileError(where, what, "convert them to degrees")
    for what, remedy in _mistakes(table, rig, places):
        raise FileError(where, what, remedy)
    if isinstance(table, PoseTable):
        return [*tracker_doubts(table, places), *doubts_of(table, rig)]
    return [*_doubts(table, rig), *doubts_of(table, rig)]


def _radians(table: Table, rig: Rig, as_read: Array, as_degrees: Array) -> bool:
    """Whether the robot does the test only if q, read as degrees, was in rad: tool poses (n, 4, 4) of both ways."""
    if np.abs(np.degrees(table.q)).max() > _TURN_RAD:
        return False
    wrong, right = off_path(as_read, table, rig), off_path(as_degrees, table, rig)
    return right is not None and wrong is not None and right.on and not wrong.on and wrong.off > _CLEARLY * right.off


def _mistakes(table: Table, rig: Rig, T: Array) -> Iterator[tuple[str, str]]:
    """What is wrong for certain, and what to do, surest first."""
    match table:
        case CircleTable():
            yield from circle_gauges(table, rig, T)
        case PoseTable():
            yield from tracker(table, T)
        case RadialTable() | RepeatabilityTable():
            if rig.tests.hemisphere:
                yield from too_far("g1_mm", table.g_mm, rig.tests.hemisphere.radius_mm)


def _doubts(table: Table, rig: Rig) -> list[str]:
    if isinstance(table, CircleTable | PoseTable) or rig.tests.hemisphere is None:
        return []
    travel, radius = float(np.ptp(table.g_mm)), rig.tests.hemisphere.radius_mm
    if travel < _UNLIKELY * radius:
        return []
    return [f"g1_mm travels {travel:.4g} mm on a radius of {radius:g} mm, more than any robot error; check its unit"]

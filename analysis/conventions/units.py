"""Units taken by mistake, where the rig and the data together prove it.

Nothing here is a matter of taste: a claim needs data that are impossible as labelled and right as claimed.
What is only unlikely is a doubt; what cannot be detected is accepted.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from analysis.conventions.finding import Finding
from analysis.conventions.gauge_units import circle_gauges, too_far
from analysis.conventions.mirror import mirror_findings
from analysis.conventions.off_path import off_path
from analysis.conventions.rail_units import rail_findings
from analysis.conventions.tracker_units import tracker
from analysis.kinematics.arm import Array, arm_of, forward
from analysis.kinematics.limits import impossible_rad
from analysis.traces.tables import CircleTable, PoseTable, RadialTable, RepeatabilityTable, Table
from rigs.rig import Rig

UNITS = "units"
_TURN_RAD = 2 * np.pi + 0.1
_CLEARLY = 3.0
"""One way to read the joints is right and the other wrong where it is off the path by this factor more."""
_UNLIKELY = 0.1
"""A robot that stops on a sphere of this share of its travel has shown its gauge more than its errors."""
_ROWS = 20_000
"""Rows that show a unit; a run may have millions."""


def unit_findings(table: Table, rig: Rig) -> Iterator[Finding]:
    """What speaks against the units of a table, surest first."""
    if most := impossible_rad(table.q):
        columns = tuple(f"q{axis}_deg" for axis in range(1, table.q.shape[1] + 1))
        what = f"a joint would stand at {np.degrees(most):.0f}°: degrees were read as radians"
        yield Finding(UNITS, "impossible", columns, "degrees", what, "read them as degrees")
        return
    table = _some(table)
    arm = arm_of(rig.robot)
    places = forward(arm, table.q)
    if _radians(table, rig, places, forward(arm, np.degrees(table.q))):
        columns = tuple(f"q{axis}_deg" for axis in range(1, arm.axes + 1))
        what = f"q1_deg … {columns[-1]} are radians: only then does the robot of the rig file follow the program"
        yield Finding(UNITS, "impossible", columns, "radians", what, "convert them to degrees")
        return
    if isinstance(table, PoseTable):
        yield from rail_findings(table, rig)
        yield from mirror_findings(table, rig, UNITS)
    for what, remedy in _mistakes(table, rig, places):
        columns = tuple(name for name in what.split() if "_" in name)
        yield Finding(UNITS, "impossible", columns, "another unit", what, remedy)
    if isinstance(table, RadialTable | RepeatabilityTable) and rig.tests.hemisphere:
        yield from _unlikely(table, rig.tests.hemisphere.radius_mm)


def _some(table: Table) -> Table:
    """A circle of so many rows at the most; other tables are short."""
    if not isinstance(table, CircleTable) or len(table.q) <= _ROWS:
        return table
    rows = slice(None, None, len(table.q) // _ROWS)
    return CircleTable(table.test, table.direction, table.t_s[rows], table.q[rows], table.g_mm[rows])


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


def _unlikely(table: RadialTable | RepeatabilityTable, radius_mm: float) -> Iterator[Finding]:
    travel = float(np.ptp(table.g_mm))
    if _UNLIKELY * radius_mm <= travel <= radius_mm:
        what = f"g1_mm travels {travel:.4g} mm on a radius of {radius_mm:g} mm, more than any robot error"
        yield Finding(UNITS, "likely", ("g1_mm",), "another unit", what, "check its unit")

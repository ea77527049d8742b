"""Whether a table was measured where and as fast as its rig file says.

By the nominal arm: it errs by some mm, and a cell is seldom where its file says to much better than 20 mm.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from analysis.conventions.finding import Finding
from analysis.conventions.off_path import places_of
from analysis.geometry.circle import frame_of
from analysis.kinematics.arm import arm_of, forward
from analysis.traces.tables import CircleTable, RadialTable, RepeatabilityTable, Table
from rigs.rig import Rig

STAMPS, PLACE = "stamps", "place"
_NEAR_MM = 20.0
_ROWS = 5000
"""So many rows are enough to see how fast a circle was driven."""
_UNITS_S = {"ms": 1e-3, "µs": 1e-6, "ns": 1e-9}
_OFF = 3.2
"""A speed within so many times of a unit's is taken as off by that unit: a circle is never driven at such a speed."""


def stamp_findings(table: Table, rig: Rig) -> Iterator[Finding]:
    """Whether the mean speed along the circle is off by a unit. Stamps that go back are refused where they are read."""
    circle = rig.tests.circle
    if not isinstance(table, CircleTable) or circle is None:
        return
    rows = slice(None, None, max(1, len(table.q) // _ROWS))
    phi = frame_of(circle).angle(forward(arm_of(rig.robot), table.q[rows])[:, :3, 3])
    seconds = float(np.ptp(table.t_s))
    if seconds == 0:
        return
    driven_rad = float(np.abs(np.diff(np.unwrap(phi))).sum())  # laps and the ways back between them
    share = driven_rad * circle.radius_mm / seconds / circle.speed_mm_s
    fact = f"the circle was driven at {share:.2g} times the speed_mm_s of the rig file"
    for unit, unit_s in _UNITS_S.items():
        if 1 / _OFF < share / unit_s < _OFF:
            yield Finding(STAMPS, "likely", ("t_s",), unit, fact, f"t_s may be in {unit}: check it")
        elif 1 / _OFF < share * unit_s < _OFF:
            yield Finding(STAMPS, "likely", ("t_s",), "another unit", fact, "check the units of t_s and speed_mm_s")


def place_findings(table: Table, rig: Rig) -> Iterator[Finding]:
    """The first reading that the nominal arm takes elsewhere than to its target."""
    hemisphere = rig.tests.hemisphere
    if hemisphere is None or not isinstance(table, RadialTable | RepeatabilityTable):
        return
    places = places_of(table, hemisphere)
    if places is None:
        return
    away = np.linalg.norm(forward(arm_of(rig.robot), table.q)[:, :3, 3] - places, axis=1)
    far = away > _NEAR_MM
    if far.any():
        row = int(np.argmax(far))
        what = (
            f"by the nominal arm the tool was {away[row]:.0f} mm from target {table.target[row]} in row {row + 1}, and "
            f"further than {_NEAR_MM:g} mm in {far.sum()} of {len(far)} rows"
        )
        yield Finding(PLACE, "likely", ("target",), "another target", what, "check target, angles, joints")

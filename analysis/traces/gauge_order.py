"""The order of the gauges of a yaw run: readings that suggest an exchange are doubted, and never refused.

The distance, the mean of the gauges, and the angle between them show one eccentricity e of the ball. Exchanged, the
angle shows -e: the two lie 2 |e| apart. An error of the arm that turns the tool in the first order of the circle moves
one of them alike, and a ball is set within a millimetre while a large fault moves it by millimetres: no reading of one
run distinguishes the two with certainty. But such an error has other orders too, so that an exchange is likely where
the two lie further apart than the rest of the readings accounts for.
"""

from __future__ import annotations

import numpy as np

from analysis.geometry.ball_link import angle
from analysis.geometry.circle import frame_of
from analysis.kinematics.arm import arm_of, forward
from analysis.traces.laps import is_on_circle
from analysis.traces.tables import CircleTable, Table
from rigs.rig import Rig

_ROWS = 5000
"""So many rows are enough to see the first order of a run."""
_WHOLE = 0.9
"""Share of a lap from which on the first order is determined."""
_CLOSER = 0.5
"""The two eccentricities lie closer by this factor with the gauges exchanged."""
_BEYOND = 2.0
"""They lie apart by more than this many times the rms of all other orders. Both factors are chosen: `scripts/dev
exchanged` counts what is doubted wrongly and what is missed."""


def doubts_of_order(table: Table, rig: Rig) -> list[str]:
    """Return a message where the readings of a yaw run look as if g1 and g2 were exchanged."""
    circle = rig.tests.circle
    if not isinstance(table, CircleTable) or table.test != "yaw" or circle is None or rig.gauges.g2 is None:
        return []
    rows = slice(None, None, max(1, len(table.q) // _ROWS))
    frame, places = frame_of(circle), forward(arm_of(rig.robot), table.q[rows])[:, :3, 3]
    on = is_on_circle(places, frame) & np.isfinite(table.g_mm[rows]).all(axis=1)
    if table.g_mm.shape[1] < 2 or not on.any():
        return []
    phi, g_mm = frame.angle(places[on]), table.g_mm[rows][on]
    if np.ptp(phi) < _WHOLE * 2 * np.pi:
        return []
    # Angles times the radius, so that both columns are in mm.
    by_gauges = angle(g_mm[:, 0], g_mm[:, 1], rig.gauges.baseline_mm)
    seen = np.stack([g_mm[:, :2].mean(axis=1), circle.radius_mm * by_gauges], axis=1)
    waves = np.stack([np.ones_like(phi), np.cos(phi), np.sin(phi)], axis=1)
    fit = np.linalg.lstsq(waves, seen, rcond=None)[0]
    by_distance, by_angle = -fit[1:, 0], np.array([-fit[2, 1], fit[1, 1]])
    apart, exchanged = np.linalg.norm(by_angle - by_distance), np.linalg.norm(by_angle + by_distance)
    rest = np.sqrt(np.mean((seen - waves @ fit) ** 2) * 2)
    if exchanged > _CLOSER * apart or apart < _BEYOND * rest:
        return []
    (u, v), (angle_u, angle_v) = by_distance, by_angle
    return [
        f"g1 and g2 may be exchanged, which reverses every angle: the ball is ({u:.2f}, {v:.2f}) mm off centre by "
        f"their mean, ({angle_u:.2f}, {angle_v:.2f}) mm by their difference; press a probe to see which is which, and "
        "exchange their columns or ports; if they are right, the robot errs by as much"
    ]

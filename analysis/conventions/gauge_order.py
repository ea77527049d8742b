"""The order and the relative sign of the gauges of a yaw run: what suggests an exchange is doubted, and never refused.

The distance, the mean of the gauges, and the angle between them show one eccentricity e of the ball. Exchanged, the
angle shows -e: the two lie 2 |e| apart. An error of the arm that turns the tool in the first order of the circle moves
one of them alike, and a ball is set within a millimetre while a large fault moves it by millimetres: no reading of one
run distinguishes the two with certainty. But such an error has other orders too, so that an exchange is likely where
the two lie further apart than the rest of the readings accounts for.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from analysis.conventions.finding import Finding
from analysis.geometry.circle import frame_of, link_angle
from analysis.kinematics.arm import Array, arm_of, forward
from analysis.traces.laps import is_on_circle
from analysis.traces.tables import CircleTable
from rigs.rig import Rig

ORDER, SIGN = "gauge order", "gauge sign"
EXCHANGED = "g1 and g2 may be exchanged"
_ROWS = 5000
"""So many rows are enough to see the first order of a run."""
_WHOLE = 0.9
"""Share of a lap from which on the first order is determined."""
_CLOSER = 0.5
"""The two eccentricities lie closer by this factor with the gauges exchanged."""
_BEYOND = 2.0
"""They lie apart by more than this many times the rms of all other orders. Both factors are chosen: `scripts/dev
exchanged` counts what is doubted wrongly and what is missed."""
_SEEN_MM, _NEGATED = 0.2, 0.25
"""With one gauge negated the two eccentricities lie within this share of one another, and are seen above this size.
Chosen: an arm that errs imitates it only by chance, in size and in direction."""


def order_findings(table: CircleTable, rig: Rig) -> Iterator[Finding]:
    """Whether the readings of a yaw run look as if g1 and g2 were exchanged, or as if one of them counted the other
    way, by the two eccentricities that each meaning of the columns shows."""
    circle = rig.tests.circle
    if circle is None or rig.gauges.g2 is None:
        return
    rows = slice(None, None, max(1, len(table.q) // _ROWS))
    frame, places = frame_of(circle), forward(arm_of(rig.robot), table.q[rows])[:, :3, 3]
    on = is_on_circle(places, frame) & np.isfinite(table.g_mm[rows]).all(axis=1)
    if table.g_mm.shape[1] < 2 or not on.any():
        return
    phi, g_mm = frame.angle(places[on]), table.g_mm[rows][on, :2]
    if np.ptp(phi) < _WHOLE * 2 * np.pi:
        return
    labelled, exchanged, first, second = (
        _Eccentricities.of(phi, g_mm[:, columns] * signs, circle.radius_mm, rig.gauges.baseline_mm)
        for columns, signs in (((0, 1), (1, 1)), ((1, 0), (1, 1)), ((0, 1), (-1, 1)), ((0, 1), (1, -1)))
    )
    if labelled.apart_mm < _BEYOND * labelled.rest_mm:
        return
    if exchanged.apart_mm <= _CLOSER * labelled.apart_mm:
        (u, v), (angle_u, angle_v) = labelled.by_distance, labelled.by_angle
        fact = (
            f"g1 and g2 may be exchanged, which reverses every angle: the ball is ({u:.2f}, {v:.2f}) mm off centre by "
            f"their mean, ({angle_u:.2f}, {angle_v:.2f}) mm by their difference"
        )
        remedy = (
            "press a probe to see which is which, and exchange their columns or ports; if they are right, the robot "
            "errs by as much"
        )
        yield Finding(ORDER, "likely", ("g1_mm", "g2_mm"), EXCHANGED, fact, remedy)
    elif labelled.size_mm > _SEEN_MM:
        for number, meaning_of_sign in ((1, first), (2, second)):
            if meaning_of_sign.apart_mm <= _NEGATED * meaning_of_sign.size_mm and labelled.apart_mm > labelled.size_mm:
                name, second_name = f"g{number}", f"g{3 - number}"
                fact = (
                    f"{name} may count the other way than {second_name}: only then do the mean of the gauges and their "
                    "difference show the ball in one place"
                )
                remedy = f"press {name} and see whether it counts as {second_name} does; give counts in the rig file, "
                remedy += "or change its sign"
                yield Finding(SIGN, "likely", (f"{name}_mm",), negated(number), fact, remedy)


@dataclass(frozen=True)
class _Eccentricities:
    """Where the ball lies off the centre, (2,) mm along phi = 0° and 90°, by the mean of two gauges and by the angle
    between them; rest_mm: rms of all else that the two show."""

    by_distance: Array
    by_angle: Array
    rest_mm: float

    @property
    def apart_mm(self) -> float:
        """How far the two contradict one another."""
        return float(np.linalg.norm(self.by_angle - self.by_distance))

    @property
    def size_mm(self) -> float:
        """How far the ball lies off by both, on the mean."""
        return float(np.linalg.norm(self.by_angle + self.by_distance)) / 2

    @classmethod
    def of(cls, phi: Array, g_mm: Array, radius_mm: float, baseline_mm: float) -> _Eccentricities:
        """From circle angles phi (n,) rad and readings g_mm (n, 2); angles times the radius, so that both are in mm."""
        by_gauges = link_angle(g_mm[:, 0], g_mm[:, 1], baseline_mm)
        seen = np.stack([g_mm.mean(axis=1), radius_mm * by_gauges], axis=1)
        waves = np.stack([np.ones_like(phi), np.cos(phi), np.sin(phi)], axis=1)
        fit = np.linalg.lstsq(waves, seen, rcond=None)[0]
        rms_mm = float(np.sqrt(np.mean((seen - waves @ fit) ** 2) * 2))
        return cls(-fit[1:, 0], np.array([-fit[2, 1], fit[1, 1]]), rms_mm)


def negated(number: int) -> str:
    """What may be meant where one gauge, 1 or 2, is negated."""
    return f"g{number} may count the other way"

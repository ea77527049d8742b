"""Roll test: orientation error about the circle's tangent, after Oh 2019, section 2.2.

roll = atan2(l·x_T, l·z_T). An eccentricity in the plane gives no first-order sine, and the height h of the ball along n
gives the constant atan(h/R), indistinguishable from a difference of the gauge zeros. A sine is caused by the robot, or
by a tilt of the plane actually driven; the orientation error is by definition (docs/conventions.md) the remainder. The
paper removes no sine in figures 10 and 11, whose extremes are 135° apart, so the range of the total angle is reported
in addition to the band.

Figures: band_deg and the positions max_at_deg and min_at_deg of the extreme orientation errors; range_deg of the total
angle, range_max_at_deg and range_min_at_deg; amplitude_deg, shift_deg and offset_deg of the sine. Band and range are
noise-corrected; phi from 0 to 360.
"""

from __future__ import annotations

import numpy as np

from analysis.procedures.circle.evaluate import SINE, AngleTest, CircleResult, Measure, eccentricities, error_of
from analysis.procedures.shared.reduction import PHI
from analysis.robot.kinematics.arm import Array

_CLEAR_MM = 0.2
_ALIKE = 0.3
"""Relative difference below which the sine of a roll equals the eccentricity from the distance. A sine caused by the
robot has this size and direction only by chance.
"""


def _notes(result: CircleResult) -> tuple[str, ...]:
    height = result.laps.frame.radius * np.tan(result.sine.A)
    note = (
        "roll cannot separate two causes of the offset: the ball is mounted "
        f"{height:.3f} mm off along n, or the gauges have wrong zeros"
    )
    as_yaw, by_distance = eccentricities(result)
    size = float(np.linalg.norm(by_distance))
    if size < _CLEAR_MM or np.linalg.norm(as_yaw - by_distance) > _ALIKE * size:
        return (note,)
    as_of_yaw = f"the sine of the angle matches the ball being {size:.2f} mm off centre"
    return note, f"this looks like a yaw run: {as_of_yaw}"


def range_figures(y: Array, _radius_mm: float) -> dict[str, Array]:
    """Return the range (...,) of the total angle and the circle angles of all extremes in degrees, for angles y
    (..., NODES) rad."""
    error, whole = error_of(y)
    at = np.degrees(PHI)
    return {
        "max_at_deg": at[np.argmax(error, axis=-1)],
        "min_at_deg": at[np.argmin(error, axis=-1)],
        "range_deg": np.degrees(np.ptp(whole, axis=-1)),
        "range_max_at_deg": at[np.argmax(whole, axis=-1)],
        "range_min_at_deg": at[np.argmin(whole, axis=-1)],
    }


MEASURES = (
    SINE,
    Measure(range_figures, frozenset({"range_deg"})),
)
ANGLE = AngleTest(MEASURES, _notes)
evaluate, plain_figures = ANGLE.evaluate, ANGLE.plain_figures

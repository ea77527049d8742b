"""Yaw test: orientation error about the circle's normal, after Oh 2019, section 2.1.

The angle between link and tool over the circle angle phi is a sine, because the base-ball is never exactly in the
circle's centre: yaw = atan2(-e_u sin + e_v cos, R - …), with the exact first harmonic (-e_u sin + e_v cos)/R. The
distance, the mean of the gauges, shows the same eccentricity independently. A note reports gross differences;
analysis/procedures/checks/gauge_sign.py detects exchanged gauges.

Figures: band_deg (noise-corrected), amplitude_deg, shift_deg, offset_deg of the sine; eccentricity_u_mm and _v_mm of
the base-ball from the circle's centre along u and v = n × u, and its length eccentricity_mm.
"""

from __future__ import annotations

import numpy as np

from analysis.procedures.circle.evaluate import SINE, AngleTest, CircleResult, Measure, eccentricities, sine_of
from analysis.robot.kinematics.arm import Array

_APART_MM = 0.2
_APART = 0.5
"""Relative difference above which two eccentricities hardly belong to the same ball, if they also exceed the
absolute limit.
"""


def eccentricity_figures(y: Array, radius_mm: float) -> dict[str, Array]:
    """Return the eccentricity (...,) in mm along u and v and its length, for angles y (..., NODES) rad."""
    _, a, b = sine_of(y)
    return {
        "eccentricity_u_mm": -radius_mm * a,
        "eccentricity_v_mm": radius_mm * b,
        "eccentricity_mm": radius_mm * np.hypot(a, b),
    }


def _notes(result: CircleResult) -> tuple[str, ...]:
    """Return a note if the two eccentricities cannot belong to the same ball."""
    by_angle, by_distance = eccentricities(result)
    apart = float(np.linalg.norm(by_angle - by_distance))
    if apart < max(_APART_MM, _APART * max(float(np.linalg.norm(e)) for e in (by_angle, by_distance))):
        return ()
    return (
        f"the eccentricities by angle and by distance differ by {apart:.2f} mm: the sign, scale or order of the gauges "
        "may be wrong, or the robot has an error of this size",
    )


MEASURES = (
    SINE,
    Measure(eccentricity_figures),
)
ANGLE = AngleTest(MEASURES, _notes)
evaluate, plain_figures = ANGLE.evaluate, ANGLE.plain_figures

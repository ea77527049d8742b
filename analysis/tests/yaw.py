"""Yaw test: orientation error about the circle's normal, after Oh 2019, section 2.1.

The angle between link and tool over circle angle phi is a sine, since the base-ball never sits in the
circle's centre: yaw = atan2(-e_u sin + e_v cos, R - …), whose first harmonic is (-e_u sin + e_v cos)/R exactly.
The distance, the mean of the gauges, tells the same eccentricity a second time. Where the two are opposite,
the gauges are swapped.
"""

from __future__ import annotations

import numpy as np

from analysis.kinematics.arm import Array
from analysis.reading.lap import Lap
from analysis.tests.circle import CircleResult, Sine, evaluate_angle, fit_sine, sine_figures
from analysis.tests.circularity import fit_circle
from analysis.tests.curve import noise_sd
from rigs.errors import FileError

__all__ = ["Sine", "Yaw", "evaluate", "fit_sine", "noise_sd", "plain_figures"]

Yaw = CircleResult
_CLEAR_MM = 0.1
"""An eccentricity from here on tells which gauge is which; below it the robot's own errors might."""


def evaluate(
    lap: Lap, baseline_mm: float, baseline_u_mm: float, u_lag_s: float, where: str = "the yaw run"
) -> CircleResult:
    """The yaw figures of one lap.

    figures: band_deg (noise-corrected), amplitude_deg, shift_deg, offset_deg of the sine; eccentricity_u_mm
    and _v_mm of the base-ball from the circle's centre along u and v = n × u, eccentricity_mm its length.
    Raises FileError, for swapped gauges too.
    """
    result = evaluate_angle(lap, baseline_mm, baseline_u_mm, u_lag_s, plain_figures, where)
    _hold_order(result, where)
    return result


def plain_figures(phi: Array, y: Array, radius_mm: float) -> dict[str, float]:
    """The plain figures of a curve y (n,) rad over phi (n,) rad, by the definitions of measurement.md."""
    sine = fit_sine(phi, y)
    return sine_figures(phi, y) | {
        "eccentricity_u_mm": -radius_mm * sine.a,
        "eccentricity_v_mm": radius_mm * sine.b,
        "eccentricity_mm": radius_mm * sine.amplitude,
    }


def _hold_order(result: CircleResult, where: str) -> None:
    radius = result.lap.frame.radius
    by_angle = radius * np.array([-result.sine.a, result.sine.b])
    by_distance = fit_circle(result.phi, result.lap.g_mm.mean(axis=1), radius)[:2]
    length = float(np.linalg.norm(by_distance))
    # Opposite within a half: robot errors may turn or stretch one of the two a little, never around.
    if length > _CLEAR_MM and np.linalg.norm(by_angle + by_distance) < 0.5 * length:
        raise FileError(
            where,
            f"the angle puts the ball at ({by_angle[0]:.2f}, {by_angle[1]:.2f}) mm from the centre, the distance "
            f"at ({by_distance[0]:.2f}, {by_distance[1]:.2f}) mm: g1 and g2 are swapped",
            "swap their offset_mm in the rig file, or the columns",
        )

"""Roll test: orientation error about the circle's tangent, after Oh 2019, section 2.2.

roll = atan2(l·x_T, l·z_T). An eccentricity in the plane gives no first-order sine, and the height h of the
ball along n gives the constant atan(h/R), which no one can tell from a difference of the gauges' zeros. A sine
that is there is the robot's, or the tilt of the plane really driven; the orientation error is by definition
(docs/geometry.md) what is left without it. The paper takes no sine off its figures 10 and 11, whose extremes lie
135° apart, so the range of the whole angle is reported beside the band.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from analysis.kinematics.arm import Array
from analysis.reading.lap import Lap
from analysis.tests.circle import CircleResult, eccentricities, evaluate_angle, fit_sine, sine_figures
from analysis.tests.curve import noise_sd, smoothed

_CLEAR_MM = 0.2
_ALIKE = 0.3
"""A robot's own sine is as large as an eccentricity of _CLEAR_MM, and points its way, by chance only."""


def evaluate(
    lap: Lap, baseline_mm: float, baseline_u_mm: float, u_lag_s: float, where: str = "the roll run"
) -> CircleResult:
    """The roll figures of one lap.

    figures: band_deg and where the orientation error is largest and smallest, max_at_deg and min_at_deg;
    range_deg of the whole angle, range_max_at_deg and range_min_at_deg; amplitude_deg, shift_deg and offset_deg
    of the sine. Band and range are noise-corrected. The places are those of the curve after smoothing; phi from
    0 to 360. Raises FileError.
    """
    result = evaluate_angle(lap, baseline_mm, baseline_u_mm, u_lag_s, plain_figures, where)
    height = lap.frame.radius * np.tan(result.sine.A)
    note = f"the offset is the ball {height:.3f} mm along n, or the gauges' zeros, or both: roll cannot tell"
    return dataclasses.replace(result, notes=(*result.notes, note, *_like_yaw(result)))


def _like_yaw(result: CircleResult) -> tuple[str, ...]:
    """Whether the angle's sine is that which a yaw run shows of the ball that the distance tells."""
    as_yaw, by_distance = eccentricities(result)
    size = float(np.linalg.norm(by_distance))
    if size < _CLEAR_MM or np.linalg.norm(as_yaw - by_distance) > _ALIKE * size:
        return ()
    return (f"this looks like a yaw run: the angle's sine is that of the {size:.2f} mm that the ball is off centre",)


def plain_figures(phi: Array, y: Array, radius_mm: float) -> dict[str, float]:
    """The plain figures of a curve y (n,) rad over phi (n,) rad, in order of phi."""
    sine = fit_sine(phi, y)(phi)
    error = smoothed(y - sine, noise_sd(y - sine))
    whole = error + sine
    at = np.degrees(phi) % 360.0
    return sine_figures(phi, y) | {
        "max_at_deg": float(at[np.argmax(error)]),
        "min_at_deg": float(at[np.argmin(error)]),
        "range_deg": float(np.degrees(np.ptp(y))),
        "range_max_at_deg": float(at[np.argmax(whole)]),
        "range_min_at_deg": float(at[np.argmin(whole)]),
    }

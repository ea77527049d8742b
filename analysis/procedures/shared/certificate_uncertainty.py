"""Uncertainty of all figures from calibration certificates.

The error of a gauge is modelled as an unknown smooth function of the reading, with standard deviation u. A wave as long
as the gauge's travel affects a figure almost fully, longer ones less: the worst case is used. A trial draws such errors
for laps and targets of the shipped rigs (tests/analysis/procedures/shared/test_certificate_uncertainty.py). Comparisons
between runs are not affected, because both have the same gauges.
"""

from __future__ import annotations

import math
from dataclasses import replace

from analysis.procedures.shared.quantity import PLACE, Quantity
from analysis.runs.noise.certificate import NO_CERTIFICATE, Systematic
from rigs.rig import Rig
from rigs.schema.vocabulary import CIRCLES, WITHOUT_GAUGES, TestName

Figures = dict[str, Quantity]
_SHORTEST_MM = 0.3
"""Correlation length of a gauge error: errors of readings further apart are independent."""
_LENGTHS = ("radius_mm", "held_radius_mm", "ap_mm", "ap_mean_mm")
"""Figures shifted fully by an error common to all readings."""


def with_certificates(figures: Figures, systematic: Systematic, rig: Rig, test: TestName) -> Figures:
    """Figures of a run with the uncertainty of certificates added in quadrature."""
    if systematic == NO_CERTIFICATE or test in WITHOUT_GAUGES:
        return figures
    u = _u_of_circle if test in CIRCLES else _u_of_targets
    return {
        name: replace(figure, u=math.hypot(figure.u, u(name, figures, systematic, rig)))
        for name, figure in figures.items()
    }


def _u_of_circle(name: str, figures: Figures, systematic: Systematic, rig: Rig) -> float:
    """Standard uncertainty of a circle figure, in its unit."""
    if name.endswith(PLACE):
        return 0.0  # a position on the circle depends on the shape of the curve, not its size
    gauges_mm = math.hypot(*systematic.gauge_mm)
    angle_rad, distance_mm = gauges_mm / rig.gauges.baseline_mm, gauges_mm / 2
    if name == "shift_deg":
        amplitude_rad = math.radians(abs(figures["amplitude_deg"].value))
        return math.degrees(angle_rad / amplitude_rad) if amplitude_rad else 0.0
    if figures[name].unit == "deg":
        ends = 2 if name.startswith("range") else 1  # the two ends of a range can be wrong in opposite directions
        return ends * math.degrees(angle_rad)
    if "eccentricity" in name:
        radius_mm = rig.tests.circle.radius_mm if rig.tests.circle else 0.0
        return radius_mm * angle_rad if f"distance_{name}" in figures else distance_mm
    return math.hypot(distance_mm, math.sqrt(2) * systematic.ball_mm)


def _u_of_targets(name: str, figures: Figures, systematic: Systematic, rig: Rig) -> float:
    """Standard uncertainty of a figure of a radial or repeatability test, mm."""
    gauge_mm, ball_mm = systematic.gauge_mm[0], systematic.ball_mm
    if name in _LENGTHS:
        return math.hypot(gauge_mm, ball_mm, systematic.link_mm)
    apart = figures.get("held_band_mm", figures[name]) if name.startswith("centre_") else figures[name]
    difference_mm = math.sqrt(2) * gauge_mm * min(1.0, abs(apart.value) / _SHORTEST_MM)
    about_ball = name.startswith(("centre_", "band", "held_band"))  # from targets with different contact points
    return math.hypot(difference_mm, math.sqrt(2) * ball_mm if about_ball else 0.0)

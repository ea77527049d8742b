"""Corrections of readings by calibration certificates, and the uncertainty that averaging over a run does not reduce.

A gauge at temperature T shows r for the length (r + correction(r)) (1 + coefficient (T - reference)). If the rig file
does not define the temperature of the cell, 20 ± 5 °C with a rectangular distribution is assumed, as in halls with no
air conditioning.
"""

from __future__ import annotations

import datetime as dt
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from analysis.robot.kinematics.arm import Array
from rigs.rig import Rig
from rigs.schema.probe import Certificate, GaugeCertificate, Temperature

_ASSUMED = Temperature(mean_c=20.0, u_c=5.0 / math.sqrt(3))
"""Temperature of the cell if the rig file does not define it: 20 ± 5 °C, rectangular, hence divided by √3."""


@dataclass(frozen=True)
class Systematic:
    """Standard uncertainties in mm that no number of readings reduces."""

    gauge_mm: tuple[float, ...] = ()
    """Error of each gauge that varies slowly over its range."""
    ball_mm: float = 0.0
    """Error of the ball's radius where the link touches it."""
    link_mm: float = 0.0
    """Error of the length of the link, common to all targets."""


NO_CERTIFICATE = Systematic()
"""The systematic uncertainty of uncertified parts."""


def correction_mm(certificate: GaugeCertificate, reading_mm: Array) -> Array:
    """Correction to add to readings; beyond the range of the certificate that of its end."""
    if certificate.valid_mm is None:
        return np.zeros_like(reading_mm)
    within = np.clip(reading_mm, *certificate.valid_mm)
    if certificate.polynomial_mm:
        of_polynomial: Array = np.polynomial.polynomial.polyval(within, np.array(certificate.polynomial_mm))
        return of_polynomial
    readings, corrections = np.array(certificate.correction_mm).T
    of_table: Array = np.interp(within, readings, corrections)
    return of_table


def corrected(certificate: GaugeCertificate, reading_mm: Array, temperature: Temperature | None) -> Array:
    return (reading_mm + correction_mm(certificate, reading_mm)) * _growth(certificate, temperature)


def as_shown(certificate: GaugeCertificate, length_mm: Array, temperature: Temperature | None) -> Array:
    """Readings of a gauge for lengths: the inverse of `corrected`."""
    at_reference = length_mm / _growth(certificate, temperature)
    if certificate.valid_mm is None:
        return at_reference
    low, high = certificate.valid_mm
    knots = [reading for reading, _ in certificate.correction_mm] or np.linspace(low, high, 1001)
    added = correction_mm(certificate, np.asarray(knots))
    shown: Array = at_reference - np.interp(at_reference, np.asarray(knots) + added, added)
    return shown


def corrected_gauges(rig: Rig, names: Sequence[str], g_mm: Array) -> tuple[Array, dict[str, int]]:
    """Corrected readings (n, k) mm of the gauges `names`, and the numbers of readings beyond the certificates.

    Input and output increase with the distance from the ball; a certificate refers to the displayed reading.
    """
    gauges, beyond = dict(rig.gauges), {}
    certified = [(column, name, held) for column, name in enumerate(names) if (held := gauges[name].certificate)]
    if certified:
        g_mm = g_mm.copy()
    for column, name, certificate in certified:
        sign = gauges[name].sign
        if certificate.valid_mm is not None:
            low, high = certificate.valid_mm
            shown_mm = sign * g_mm[:, column]
            beyond[name] = int(np.count_nonzero((shown_mm < low) | (shown_mm > high)))
        g_mm[:, column] = sign * corrected(certificate, sign * g_mm[:, column], rig.temperature)
    return g_mm, beyond


def beyond_certificates(rig: Rig, beyond: Mapping[str, int], rows: int) -> list[str]:
    doubts, gauges = [], dict(rig.gauges)
    for name, count in beyond.items():
        certificate = gauges[name].certificate
        if count and certificate and certificate.valid_mm:
            low, high = certificate.valid_mm
            doubts.append(
                f"{name}: {count} of {rows} readings are outside the range {low:g} to {high:g} mm of "
                f"certificate {certificate.number}; they are corrected as at the end"
            )
    return doubts


def link_excess_mm(rig: Rig) -> float:
    """Excess of the certified link length, at cell temperature, over the hemisphere's radius."""
    if rig.link is None or rig.tests.hemisphere is None:
        return 0.0
    return rig.link.length_mm * _growth(rig.link, rig.temperature) - rig.tests.hemisphere.radius_mm


def systematic(rig: Rig, g_mm: Array) -> Systematic:
    gauges = [gauge.certificate for _, gauge in rig.gauges][: g_mm.shape[1]]
    # A wave of unknown phase has a standard deviation of 1 / (2 √2) of the peak-to-valley height.
    form_mm = rig.ball.form_mm / (2 * math.sqrt(2)) if rig.ball else 0.0
    return Systematic(
        tuple(
            _u_mm(certificate, max(abs(float(column.min())), abs(float(column.max()))), rig) if certificate else 0.0
            for certificate, column in zip(gauges, g_mm.T, strict=True)
        ),
        math.hypot(form_mm, _u_mm(rig.ball, 0.0, rig)),
        _u_mm(rig.link, rig.link.length_mm if rig.link else 0.0, rig),
    )


def doubts_of(rig: Rig, names: Sequence[str], on: dt.date) -> list[str]:
    parts = [*((name, gauge.certificate) for name, gauge in rig.gauges), ("ball", rig.ball), ("link", rig.link)]
    certificates = [(name, certificate) for name, certificate in parts if certificate is not None and name in names]
    overdue = [
        f"{name}: certificate {certificate.number} was valid until {certificate.due}, which is before {on}; "
        "have it recalibrated"
        for name, certificate in certificates
        if certificate.due is not None and certificate.due < on
    ]
    if rig.temperature is None and any(certificate.coefficient_per_c for _, certificate in certificates):
        overdue.append("the rig file does not give the temperature of the cell: 20 ± 5 °C is assumed; set temperature")
    return overdue


def _growth(certificate: Certificate, temperature: Temperature | None) -> float:
    warmer_c = (temperature or _ASSUMED).mean_c - certificate.reference_c
    return 1.0 + certificate.coefficient_per_c * warmer_c


def _u_mm(certificate: Certificate | None, length_mm: float, rig: Rig) -> float:
    if certificate is None:
        return 0.0
    by_warmth = certificate.coefficient_per_c * length_mm * (rig.temperature or _ASSUMED).u_c
    return math.hypot(certificate.u_mm / certificate.k, by_warmth)

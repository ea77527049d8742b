"""Yaw test: orientation error about the circle's normal, after Oh 2019, section 2.1.

The angle between link and tool over circle angle phi is a sine, since the base-ball never sits in the
circle's centre; what is left after the least-squares sine, eqs. (1) to (11), is the orientation error,
and its maximum less its minimum the error band.

Uncertainties are by Monte Carlo (JCGM 101): reading noise as the data show it, where the samples happened
to fall, the gauges' time against the robot's, and the baseline. The largest less the smallest of noisy
values is too large on average; the same draws tell by how much, and the band is corrected for it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.ball_link import angle
from analysis.kinematics.arm import Array
from analysis.lap import Lap
from analysis.quantity import Quantity, from_draws

_DRAWS = 400
_SEED = 0
"""Fixed, so that the same run gives the same report."""
_SMOOTH_ROWS = 7


@dataclass(frozen=True)
class Sine:
    """Least-squares A + a sin(phi) + b cos(phi), eq. (4), in rad."""

    A: float
    a: float
    b: float

    def __call__(self, phi: Array) -> Array:
        """Its value (n,) at phi (n,)."""
        values: Array = self.A + self.a * np.sin(phi) + self.b * np.cos(phi)
        return values

    @property
    def amplitude(self) -> float:
        """r of eq. (11)."""
        return float(np.hypot(self.a, self.b))

    @property
    def shift(self) -> float:
        """alpha of eq. (11); by atan2, since arctan(b/a) loses the quadrant. (The paper's last formula
        for it has b11 where b21 belongs.)"""
        return float(np.arctan2(self.b, self.a))


def fit_sine(phi: Array, y: Array) -> Sine:
    """The least-squares sine of eq. (2) through y (n,) rad at phi (n,) rad."""
    design = np.stack([np.ones_like(phi), np.sin(phi), np.cos(phi)], axis=1)
    A, a, b = np.linalg.lstsq(design, y, rcond=None)[0]
    return Sine(float(A), float(a), float(b))


@dataclass(frozen=True)
class Yaw:
    """Result of one direction. phi, angle, residual: (n,) rad in order of time."""

    lap: Lap
    phi: Array
    angle: Array
    residual: Array
    sine: Sine
    noise_deg: float
    figures: dict[str, Quantity]


def evaluate(lap: Lap, baseline_mm: float, baseline_u_mm: float, u_lag_s: float) -> Yaw:
    """The yaw figures of one lap.

    figures: band_deg (noise-corrected), amplitude_deg, shift_deg, offset_deg of the sine; eccentricity_u_mm
    and _v_mm of the base-ball from the circle's centre along u and v = n × u, eccentricity_mm its length.
    """
    y = angle(lap.g_mm[:, 0], lap.g_mm[:, 1], baseline_mm)
    sine = fit_sine(lap.phi, y)
    residual = y - sine(lap.phi)
    noise = noise_sd(residual)
    smooth = smoothed(residual) + sine(lap.phi)
    rate = np.gradient(lap.phi, lap.t_s) if len(lap.phi) > 2 else np.zeros_like(lap.phi)
    rng = np.random.default_rng(_SEED)
    draws = []
    rows = np.arange(len(y))
    for _ in range(_DRAWS):
        # Each row might as well have fallen half way to its neighbours.
        fallen = rows + rng.uniform(-0.5, 0.5, len(y))
        phi, curve = np.interp(fallen, rows, lap.phi), np.interp(fallen, rows, smooth)
        late = rate * rng.normal(0.0, u_lag_s)
        scale = 1.0 + rng.normal(0.0, baseline_u_mm / abs(baseline_mm))
        noisy = (curve + rng.normal(0.0, noise, len(y))) / scale
        draws.append(plain_figures(phi + late, noisy, lap.frame.radius))
    spread = {name: np.array([draw[name] for draw in draws]) for name in draws[0]}
    values = plain_figures(lap.phi, y, lap.frame.radius)
    # What noise adds to a range, by the draws about the smoothed curve, whose own range is known.
    values["band_deg"] -= (
        float(spread["band_deg"].mean()) - plain_figures(lap.phi, smooth, lap.frame.radius)["band_deg"]
    )
    figures = {name: from_draws(value, spread[name], name.rsplit("_", 1)[1]) for name, value in values.items()}
    return Yaw(lap, lap.phi, y, residual, sine, float(np.degrees(noise)), figures)


def plain_figures(phi: Array, y: Array, radius_mm: float) -> dict[str, float]:
    """The plain figures of a curve y (n,) rad over phi (n,) rad, by the definitions of measurement.md."""
    sine = fit_sine(phi, y)
    return {
        "band_deg": float(np.degrees(np.ptp(y - sine(phi)))),
        "amplitude_deg": float(np.degrees(sine.amplitude)),
        "shift_deg": float(np.degrees(sine.shift)),
        "offset_deg": float(np.degrees(sine.A)),
        # yaw = atan2(-e_u sin + e_v cos, R - …): the first harmonic of that is (-e_u sin + e_v cos)/R exactly.
        "eccentricity_u_mm": -radius_mm * sine.a,
        "eccentricity_v_mm": radius_mm * sine.b,
        "eccentricity_mm": radius_mm * sine.amplitude,
    }


def noise_sd(y: Array) -> float:
    """Standard deviation of the white part of a curve (n,) sampled in order.

    By third differences, which a smooth curve barely passes (Gasser, Sroka and Jennen-Steinmetz 1986),
    and by their median, so that a jump or two do not count.
    """
    third = np.diff(y, 3)
    return float(np.median(np.abs(third)) / 0.6745 / np.sqrt(20.0))


def smoothed(y: Array) -> Array:
    """A curve (n,) sampled in order, its noise reduced, by quadratics over a few rows (Savitzky and Golay 1964)."""
    from scipy.signal import savgol_filter  # noqa: PLC0415 - slow to import, needed here only

    values: Array = savgol_filter(y, _SMOOTH_ROWS, 2)
    return values

"""The angle between link and tool over a circle: what yaw and roll share, after Oh 2019, section 2.1.

What is left of the angle after the least-squares sine, eqs. (1) to (11), is the orientation error, and its
maximum less its minimum the error band. Which figures are taken besides, yaw and roll say themselves.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from analysis.kinematics.arm import Array
from analysis.model.ball_link import angle
from analysis.reading.lap import Lap
from analysis.reporting.quantity import Quantity, figures_of
from analysis.tests.checks import hold_alive, hold_numbers, hold_radius
from analysis.tests.circularity import fit_circle
from analysis.tests.curve import DRAWS, SEED, Curve, curve_of, means, stacked
from rigs.errors import FileError

Plain = Callable[[Array, Array, float], dict[str, float]]
"""The plain figures of an angle (n,) rad over phi (n,) rad on a circle of a radius in mm, by name."""
RANGES = frozenset({"band_deg", "range_deg"})
"""Figures that noise makes too large."""


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
    """The least-squares sine of eq. (2) through y (n,) rad at phi (n,) rad of one lap, in order of either direction.

    Each row counts by the arc that it stands for: the paper's plain sums where rows are evenly spaced, and no pull
    towards where they are dense.
    """
    design = np.stack([np.ones_like(phi), np.sin(phi), np.cos(phi)], axis=1)
    weight = np.sqrt(_arcs(phi))
    A, a, b = np.linalg.lstsq(design * weight[:, None], y * weight, rcond=None)[0]
    return Sine(float(A), float(a), float(b))


def _arcs(phi: Array) -> Array:
    """Half the way from the neighbour before to the one behind, (n,) rad, around the circle."""
    around = np.concatenate([phi[-1:], phi, phi[:1]])
    steps = np.abs((np.diff(around) + np.pi) % (2 * np.pi) - np.pi)
    return (steps[1:] + steps[:-1]) / 2


@dataclass(frozen=True)
class CircleResult:
    """Result of one direction. phi, angle, residual: (n,) rad in order of time; curve: the angle and its noise;
    u_lag_s, u_scale: what was assumed of the gauges' time and of the baseline (relative)."""

    lap: Lap
    phi: Array
    angle: Array
    residual: Array
    sine: Sine
    figures: dict[str, Quantity]
    samples: int
    notes: tuple[str, ...]
    curve: Curve
    u_lag_s: float
    u_scale: float


def evaluate_angle(
    lap: Lap, baseline_mm: float, baseline_u_mm: float, u_lag_s: float, plain: Plain, where: str
) -> CircleResult:
    """The figures of one lap by `plain`, ranges corrected for noise, each with its uncertainty.

    Raises FileError for readings that no ball link gives.
    """
    _hold(lap, baseline_mm, where)
    y = angle(lap.g_mm[:, 0], lap.g_mm[:, 1], baseline_mm)
    sine = fit_sine(lap.phi, y)
    curve = curve_of(lap, y, sine(lap.phi))
    radius, u_scale = lap.frame.radius, baseline_u_mm / abs(baseline_mm)
    rng = np.random.default_rng(SEED)
    draws, calm = [], []
    for _ in range(DRAWS):
        lag, scale = rng.normal(0.0, u_lag_s), 1.0 + rng.normal(0.0, u_scale)
        phi, noisy, quiet = curve.drawn(rng, lag, scale)
        draws.append(plain(phi, noisy, radius))
        calm.append(plain(phi, quiet, radius))
    figures = figures_of(plain(lap.phi, y, radius), stacked(draws), len(y), means(calm, RANGES))
    residual = y - sine(lap.phi)
    return CircleResult(lap, lap.phi, y, residual, sine, figures, len(y), lap.notes, curve, u_lag_s, u_scale)


def eccentricities(result: CircleResult) -> tuple[Array, Array]:
    """Where the ball lies from the centre along u and v, (2,) mm each: by the angle of a yaw, and by the distance."""
    radius = result.lap.frame.radius
    by_angle = radius * np.array([-result.sine.a, result.sine.b])
    return by_angle, fit_circle(result.phi, result.lap.g_mm.mean(axis=1), radius)[:2]


def sine_figures(phi: Array, y: Array) -> dict[str, float]:
    """Band, amplitude, shift and offset: the paper's section 2.1."""
    sine = fit_sine(phi, y)
    return {
        "band_deg": float(np.degrees(np.ptp(y - sine(phi)))),
        "amplitude_deg": float(np.degrees(sine.amplitude)),
        "shift_deg": float(np.degrees(sine.shift)),
        "offset_deg": float(np.degrees(sine.A)),
    }


def _hold(lap: Lap, baseline_mm: float, where: str) -> None:
    if lap.g_mm.ndim != 2 or lap.g_mm.shape[1] != 2:
        raise FileError(where, "has not two gauges, and an angle takes two", "give g1_mm and g2_mm")
    if baseline_mm == 0:
        raise FileError(where, "the gauges stand at the same place", "correct offset_mm of g1 and g2 in the rig file")
    hold_radius(where, lap.frame.radius)
    hold_numbers(where, t_s=lap.t_s, q=lap.q, g1_mm=lap.g_mm[:, 0], g2_mm=lap.g_mm[:, 1])
    hold_alive(where, g1_mm=lap.g_mm[:, 0], g2_mm=lap.g_mm[:, 1])

"""Circular deviation of a circle run, by the mean of its two gauges, which follows the distance of tool and ball.

After ISO 230-4:2005, clause 3: the circular deviation G is the range of the radial deviations about the
least-squares circle. The link has no absolute length here (the gauges' zeros are in it), so the standard's
radial deviation F and mean radius D are not reported.

The distance of P = C + R r(phi) from B = C + e is |R r(phi) - e|, and it is that curve, not its first harmonic
alone, that is fitted: e²/4R of second harmonic is no error of the robot (2 µm for 0.7 mm at 70 mm). The
factor 1/(l·z_T) in a reading is left alone: it is below 1 µm where the angle is below 1° and the gauges stand
within 5 mm of their zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.kinematics.arm import Array
from analysis.reading.lap import Lap
from analysis.reporting.quantity import Quantity, figures_of
from analysis.tests.checks import hold_alive, hold_numbers, hold_radius
from analysis.tests.curve import DRAWS, SEED, Curve, curve_of, means, stacked


@dataclass(frozen=True)
class Circularity:
    """Result of one direction. phi (n,) rad, deviation (n,) mm outwards, in order of time; curve: the distance."""

    lap: Lap
    phi: Array
    deviation_mm: Array
    curve: Curve
    u_lag_s: float
    figures: dict[str, Quantity]
    samples: int
    notes: tuple[str, ...]


def evaluate(lap: Lap, u_lag_s: float, where: str = "the circle run") -> Circularity:
    """figures: circular_deviation_mm G of one direction, noise-corrected; eccentricity_u_mm, _v_mm and _mm of
    the ball by the distance, which the robot's orientation errors do not touch. Raises FileError."""
    hold_radius(where, lap.frame.radius)
    hold_numbers(where, t_s=lap.t_s, g_mm=lap.g_mm)
    distance = lap.g_mm.mean(axis=1)
    hold_alive(where, g_mm=distance)
    radius = lap.frame.radius
    fit = fit_circle(lap.phi, distance, radius)
    curve = curve_of(lap, distance, circle_at(lap.phi, fit, radius))
    rng = np.random.default_rng(SEED)
    draws, calm = [], []
    for _ in range(DRAWS):
        phi, noisy, quiet = curve.drawn(rng, rng.normal(0.0, u_lag_s))
        draws.append(plain_figures(phi, noisy, radius))
        calm.append(plain_figures(phi, quiet, radius))
    still = means(calm, ("circular_deviation_mm",))
    figures = figures_of(plain_figures(lap.phi, distance, radius), stacked(draws), len(distance), still)
    deviation = distance - circle_at(lap.phi, fit, radius)
    return Circularity(lap, lap.phi, deviation, curve, u_lag_s, figures, len(distance), lap.notes)


def plain_figures(phi: Array, distance: Array, radius_mm: float) -> dict[str, float]:
    """The plain figures of distances (n,) mm, from any zero, over phi (n,) rad."""
    fit = fit_circle(phi, distance, radius_mm)
    return {
        "circular_deviation_mm": float(np.ptp(distance - circle_at(phi, fit, radius_mm))),
        "eccentricity_u_mm": float(fit[0]),
        "eccentricity_v_mm": float(fit[1]),
        "eccentricity_mm": float(np.hypot(fit[0], fit[1])),
    }


def fit_circle(phi: Array, distance: Array, radius_mm: float) -> Array:
    """Least-squares e_u, e_v and constant c, (3,) mm, of |R r(phi) - e| + c through distances (n,) mm."""
    fit = np.zeros(3)
    for _ in range(4):
        design = np.stack([*_slopes(phi, fit, radius_mm), np.ones_like(phi)], axis=1)
        misfit = distance - circle_at(phi, fit, radius_mm)
        step: Array = np.linalg.solve(design.T @ design, design.T @ misfit)
        fit = fit + step
        if np.abs(step).max() < 1e-9:
            break
    return fit


def circle_at(phi: Array, fit: Array, radius_mm: float) -> Array:
    """|R r(phi) - e| + c (n,) mm."""
    x, y = radius_mm * np.cos(phi) - fit[0], radius_mm * np.sin(phi) - fit[1]
    values: Array = np.hypot(x, y) + fit[2]
    return values


def _slopes(phi: Array, fit: Array, radius_mm: float) -> tuple[Array, Array]:
    x, y = radius_mm * np.cos(phi) - fit[0], radius_mm * np.sin(phi) - fit[1]
    distance = np.hypot(x, y)
    return -x / distance, -y / distance

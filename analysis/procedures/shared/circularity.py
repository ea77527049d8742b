"""Circular deviation of a circle run, from the mean of its two gauges, which follows the distance between tool and
ball.

ISO 230-4:2005, clause 3: the circular deviation G is the range of the radial deviations about the least-squares circle.
The absolute length of the link is unknown (it includes the gauge zeros), so the radial deviation F and the mean radius
D of the standard are not reported.

The distance of P = C + R r(phi) from B = C + e is |R r(phi) - e|, and this curve is fitted, not only its first
harmonic: the
second harmonic e²/4R is not an error of the robot (2 µm for 0.7 mm at 70 mm). The factor 1/(l·z_T) of a reading is
ignored: its effect is below 1 µm for angles below 1° and gauges within 5 mm of zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.procedures.shared.lap_curve import SEED, LapCurve, at_resolution, curve_of, figures
from analysis.procedures.shared.quantity import Quantity
from analysis.procedures.shared.reduction import PHI, Reduced, nodes_of
from analysis.robot.kinematics.arm import Array
from analysis.runs.noise.spectrum import DRAWS, NODES, LapNoise

RANGES = frozenset({"circular_deviation_mm"})
_ROUNDS = 4
"""Rounds of Gauss-Newton; an eccentricity of a tenth of the radius needs three to reach 1 nm."""


@dataclass(frozen=True)
class Circularity:
    """Circular deviation of one direction.

    deviation_mm (NODES,): radial deviation at the circle angles PHI, positive outwards, at the stated resolution.
    curve: distance between tool and ball. ball_mm (2,): centre of the least-squares circle, along u and v.
    """

    deviation_mm: Array
    curve: LapCurve
    ball_mm: Array
    figures: dict[str, Quantity]


def evaluate(run: Reduced, radius: float, u_lag_s: float, like: LapNoise | None = None) -> Circularity:
    """Circular deviation and eccentricity of one direction.

    figures: circular_deviation_mm G, noise-corrected; eccentricity_u_mm, _v_mm and _mm of the ball from the distance,
    independent of orientation errors.
    """
    curve = curve_of(run, mean_of_gauges, np.sqrt(0.5), 1, like)
    turned = curve.turned(np.random.default_rng(SEED).normal(0.0, u_lag_s, DRAWS))

    def draw_noise(curves: Sequence[Array]) -> list[Array]:
        return [curve.draw_noise(curves[0], turned, np.ones(DRAWS))]

    of_distance = figures(lambda d: figures_at(d[0], radius), [curve], draw_noise, run.samples, RANGES)
    fit = fit_circle(curve.y, radius)
    return Circularity(at_resolution(curve.y - circle_at(fit, radius)), curve, fit[:2], of_distance)


def plain_figures(phi: Array, distance: Array, radius_mm: float) -> dict[str, float]:
    return {name: float(value) for name, value in figures_at(nodes_of(phi, distance), radius_mm).items()}


def figures_at(distance: Array, radius_mm: float) -> dict[str, Array]:
    fit, circle = circle_through(distance, radius_mm)
    deviation = at_resolution(distance - circle)
    return {
        "circular_deviation_mm": np.ptp(deviation, axis=-1),
        "eccentricity_u_mm": fit[..., 0],
        "eccentricity_v_mm": fit[..., 1],
        "eccentricity_mm": np.hypot(fit[..., 0], fit[..., 1]),
    }


def mean_of_gauges(g_mm: Array) -> Array:
    """Distance (...,) mm, relative to the gauge zeros, for readings (..., 2) mm."""
    return np.asarray((g_mm[..., 0] + g_mm[..., 1]) / 2)


def fit_circle(distance: Array, radius_mm: float) -> Array:
    """Least-squares e_u, e_v and constant c, (..., 3) mm, of |R r(phi) - e| + c for distances (..., NODES)
    mm."""
    return circle_through(distance, radius_mm)[0]


def circle_through(distance: Array, radius_mm: float) -> tuple[Array, Array]:
    """Fit (..., 3) mm of `fit_circle`, and the distances (..., NODES) mm of the fitted circle.

    The derivatives by e_u and e_v are close to -cos and -sin, so each round removes the orders 0 and 1 of the residual.
    """
    # Draws are within micrometres of their mean: one or two rounds starting at its fit are sufficient.
    fit = np.zeros(3)
    mean = distance.reshape(-1, NODES).mean(axis=0)
    for _ in range(_ROUNDS):
        fit = fit + _orders(mean - circle_at(fit, radius_mm))
    fit = fit + _orders(distance - circle_at(fit, radius_mm))
    circle = circle_at(fit, radius_mm)
    # The last step is nanometres, so the approximate derivatives are exact enough.
    last = _orders(distance - circle)
    return fit + last, circle + last @ _WAVES


_WAVES = np.stack([-np.cos(PHI), -np.sin(PHI), np.ones(NODES)])
"""Derivatives (3, NODES) of a distance by e_u, e_v and c, for a ball close to the centre."""


def _orders(y: Array) -> Array:
    """Least-squares components (..., 3) of curves (..., NODES) along _WAVES; nodes are equidistant."""
    return np.asarray(y @ (_WAVES * np.array([2.0, 2.0, 1.0])[:, None] / NODES).T)


def circle_at(fit: Array, radius_mm: float) -> Array:
    """|R r(phi) - e| + c (..., NODES) mm over PHI, for fits (..., 3) mm."""
    x, y = radius_mm * np.cos(PHI) - fit[..., 0, None], radius_mm * np.sin(PHI) - fit[..., 1, None]
    return np.asarray(np.hypot(x, y) + fit[..., 2, None])

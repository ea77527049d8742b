"""Least-squares sphere through points seen from a ball, and which of them do not belong to it.

A target is left out only where no robot error explains it, since what a robot does is what is measured: plays make
a few targets differ from the others by much more than those do among themselves. So one of its readings must lie
(1) more than 2 mm and (2) more than ten robust standard deviations of all readings (scaled median of absolute
residuals) from a sphere fitted with the soft_l1 loss, which a few bad readings barely move, and (3) no more than one
target in ten (or a single one) may be so. A wrong place is off in all orientations, a slip of the gauge in one.
Otherwise every target stays.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.kinematics.arm import Array

_GROSS_MM = 2.0
"""More than the largest play that the paper reports (Oh 2019, figure 15: 1.567 mm)."""
_SPREADS = 10.0
_MOST = 0.1
_FEWEST = 6


@dataclass(frozen=True)
class Sphere:
    """centre (3,) mm; radius mm; residual (n,) mm: distance of each point from the centre less the radius;
    design (n, k): slope of each distance by the k fitted parameters, the radius last."""

    centre: Array
    radius: float
    residual: Array
    design: Array


def free_sphere(points: Array) -> Sphere:
    """Through points (n, 3) mm, centre and radius free (geometric distance, Gauss-Newton)."""
    from scipy.optimize import least_squares  # noqa: PLC0415 - slow to import, needed here only

    def misfit(x: Array) -> Array:
        return _off(points, x)

    def slope(x: Array) -> Array:
        return _design(points, x[:3])

    found = least_squares(misfit, _start(points), jac=slope, method="lm")
    return Sphere(found.x[:3], float(found.x[3]), misfit(found.x), -_design(points, found.x[:3]))


def conditioned(points: Array) -> bool:
    """Whether points (n, 3) tell centre and radius apart: not all near one circle or one place."""
    values = np.linalg.svd(_design(points, np.zeros(3)), compute_uv=False)
    return bool(values[-1] > 0.01 * values[0])


def far_off(points: Array) -> NDArray[np.bool_]:
    """Which targets (t,) are left out, by the rule above; points (t, o, 3) mm of o readings, NaN where none is."""
    distance = _off_robust(points)
    gross = max(_GROSS_MM, _SPREADS * _spread(distance[np.isfinite(distance)]))
    far = np.any(np.abs(distance) > gross, axis=1)
    means = np.nanmean(points[~far], axis=1)
    if far.sum() > max(1, _MOST * len(far)) or len(means) < _FEWEST or not conditioned(means):
        return np.zeros(len(points), dtype=bool)
    return np.asarray(far)


def _off_robust(points: Array) -> Array:
    """Distance (t, o) mm of each reading from a sphere that a few bad ones barely move."""
    from scipy.optimize import least_squares  # noqa: PLC0415

    there = points[np.isfinite(points).all(axis=-1)]

    def misfit(x: Array) -> Array:
        return _off(there, x)

    robust = np.append(np.zeros(3), np.median(np.linalg.norm(there, axis=1)))
    for _ in range(3):
        scale = max(_spread(misfit(robust)), 1e-6)
        robust = least_squares(misfit, robust, loss="soft_l1", f_scale=scale, x_scale=[1.0, 1.0, 1.0, 1.0]).x
    return _off(points, np.asarray(robust))


def _off(points: Array, x: Array) -> Array:
    """Distance (...,) of points (..., 3) from the sphere x: centre and radius."""
    values: Array = np.linalg.norm(points - x[:3], axis=-1) - x[3]
    return values


def _design(points: Array, centre: Array) -> Array:
    """Slope (n, 4) of distance less radius by centre and radius."""
    line = points - centre
    unit = line / np.linalg.norm(line, axis=1)[:, None]
    return np.concatenate([-unit, -np.ones((len(points), 1))], axis=1)


def _start(points: Array) -> Array:
    return np.append(np.zeros(3), np.linalg.norm(points, axis=1).mean())


def _spread(residual: Array) -> float:
    return float(1.4826 * np.median(np.abs(residual - np.median(residual))))

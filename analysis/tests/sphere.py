"""Least-squares sphere through points seen from a ball, and which of them do not belong to it.

A point is left out only where it is far beyond: (1) more than six robust standard deviations (scaled median of
absolute residuals) from a sphere fitted with the soft_l1 loss, which a few bad points barely move, and
(2) beyond, with a probability of 1 in 1000 over all points, what the least-squares sphere of the rest
predicts for it (Student's t of the deleted residual, Bonferroni over the points; Cook and Weisberg 1982), and
(3) no more than one point in five is. Otherwise the odd points are the robot, and stay.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.kinematics.arm import Array

_FAR = 6.0
_CHANCE = 0.001
_MOST = 0.2


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
        values: Array = np.linalg.norm(points - x[:3], axis=1) - x[3]
        return values

    def slope(x: Array) -> Array:
        return _design(points, x[:3])

    found = least_squares(misfit, _start(points), jac=slope, method="lm")
    return Sphere(found.x[:3], float(found.x[3]), misfit(found.x), -_design(points, found.x[:3]))


def held_sphere(points: Array) -> Sphere:
    """Through points (n, 3) mm, the centre held at the origin."""
    distance = np.linalg.norm(points, axis=1)
    radius = float(distance.mean())
    return Sphere(np.zeros(3), radius, distance - radius, np.ones((len(points), 1)))


def conditioned(points: Array) -> bool:
    """Whether points (n, 3) tell centre and radius apart: not all near one circle or one place."""
    values = np.linalg.svd(_design(points, np.zeros(3)), compute_uv=False)
    return bool(values[-1] > 0.01 * values[0])


def far_off(points: Array) -> NDArray[np.bool_]:
    """Which of the points (n, 3) mm are far off the sphere of the others, by the rule above: (n,)."""
    from scipy.optimize import least_squares  # noqa: PLC0415
    from scipy.stats import t as student  # noqa: PLC0415

    count = len(points)
    start = np.append(np.zeros(3), np.median(np.linalg.norm(points, axis=1)))

    def misfit(x: Array) -> Array:
        values: Array = np.linalg.norm(points - x[:3], axis=1) - x[3]
        return values

    robust = start
    for _ in range(3):
        scale = max(_spread(misfit(robust)), 1e-6)
        robust = least_squares(misfit, robust, loss="soft_l1", f_scale=scale, x_scale=[1.0, 1.0, 1.0, 1.0]).x
    odd = np.abs(misfit(robust)) > _FAR * max(_spread(misfit(robust)), 1e-6)
    rest = ~odd
    if not odd.any() or odd.sum() > _MOST * count or rest.sum() < 6 or not conditioned(points[rest]):
        return np.zeros(count, dtype=bool)
    sphere = free_sphere(points[rest])
    freedom = int(rest.sum()) - 4
    variance = float(sphere.residual @ sphere.residual) / freedom
    slopes = -_design(points, sphere.centre)
    inverse = np.linalg.inv(sphere.design.T @ sphere.design)
    expected = np.sqrt(variance * (1.0 + np.einsum("ni,ij,nj->n", slopes, inverse, slopes)))
    deleted = np.linalg.norm(points - sphere.centre, axis=1) - sphere.radius
    beyond = np.abs(deleted) > student.ppf(1 - _CHANCE / (2 * count), freedom) * expected
    far: NDArray[np.bool_] = odd & beyond
    return far


def _design(points: Array, centre: Array) -> Array:
    """Slope (n, 4) of distance less radius by centre and radius."""
    line = points - centre
    unit = line / np.linalg.norm(line, axis=1)[:, None]
    return np.concatenate([-unit, -np.ones((len(points), 1))], axis=1)


def _start(points: Array) -> Array:
    return np.append(np.zeros(3), np.linalg.norm(points, axis=1).mean())


def _spread(residual: Array) -> float:
    return float(1.4826 * np.median(np.abs(residual - np.median(residual))))

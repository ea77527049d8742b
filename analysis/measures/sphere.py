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
from analysis.noise.wild import MOST, SPREADS

PARAMETERS = ("centre_x_mm", "centre_y_mm", "centre_z_mm", "radius_mm")
"""The unknowns of a sphere, in the order of the columns of its design."""
_GROSS_MM = 2.0
"""More than the largest play that the paper reports (Oh 2019, figure 15: 1.567 mm)."""
_FEWEST = 6
_WEAK = 0.01
"""Directions of the parameters whose singular value is below this share of the largest are not determined."""
_STEPS, _ROBUST_STEPS = 6, 30
"""Gauss-Newton on a sphere whose points lie within a hundredth of it converges in three; reweighting takes longer."""


@dataclass(frozen=True)
class Sphere:
    """centre (3,) mm; radius mm; residual (n,) mm: distance of each point from the centre less the radius;
    slopes (4, n): what each of `PARAMETERS` answers to each distance; design (n, 4): the reverse; unknown: names of
    those parameters that these points do not determine, which stay near their start."""

    centre: Array
    radius: float
    residual: Array
    slopes: Array
    design: Array
    unknown: tuple[str, ...]


def free_sphere(points: Array) -> Sphere:
    """Through points (n, 3) mm, centre and radius free (geometric distance, Gauss-Newton)."""
    x = np.append(np.zeros(3), np.linalg.norm(points, axis=1).mean())
    for _ in range(_STEPS):
        x = x + _slopes(_design(points, x[:3])) @ _off(points, x)
    design = _design(points, x[:3])
    return Sphere(x[:3], float(x[3]), _off(points, x), _slopes(design), design, _unknown(design))


def conditioned(points: Array) -> bool:
    """Whether points (n, 3) mm determine centre and radius: not all near one circle or one place."""
    return not _unknown(_design(points, np.zeros(3)))


def far_off(points: Array) -> NDArray[np.bool_]:
    """Which targets (t,) are left out, by the rule above; points (t, o, 3) mm of o readings, NaN where none is."""
    # From a sphere that a few bad readings barely move: soft_l1 by reweighting.
    read = points[np.isfinite(points).all(axis=-1)]
    x = np.append(np.zeros(3), np.median(np.linalg.norm(read, axis=1)))
    for _ in range(_ROBUST_STEPS):
        off, design = _off(read, x), _design(read, x[:3])
        root = (1 + (off / max(_spread(off), 1e-6)) ** 2) ** -0.25
        x = x + _slopes(design * root[:, None]) @ (off * root)
    distance = _off(points, x)
    gross = max(_GROSS_MM, SPREADS * _spread(distance[np.isfinite(distance)]))
    far = np.any(np.abs(distance) > gross, axis=1)
    means = np.nanmean(points[~far], axis=1)
    if far.sum() > max(1, MOST * len(far)) or len(means) < _FEWEST or not conditioned(means):
        return np.zeros(len(points), dtype=bool)
    return np.asarray(far)


def _off(points: Array, x: Array) -> Array:
    """Distance (...,) of points (..., 3) from the sphere x: centre and radius."""
    return np.asarray(np.linalg.norm(points - x[:3], axis=-1) - x[3])


def _design(points: Array, centre: Array) -> Array:
    """Slope (n, 4) of each point's distance from a sphere's surface by its centre and radius, as it moves outwards."""
    line = points - centre
    unit = line / np.linalg.norm(line, axis=1)[:, None]
    return np.concatenate([unit, np.ones((len(points), 1))], axis=1)


def _slopes(design: Array) -> Array:
    return np.asarray(np.linalg.pinv(design, rcond=_WEAK), dtype=float)


def _unknown(design: Array) -> tuple[str, ...]:
    _, s, V = np.linalg.svd(design, full_matrices=False)
    share = (V[s < _WEAK * s[0]] ** 2).sum(axis=0)
    return tuple(name for name, hidden in zip(PARAMETERS, share, strict=True) if hidden > _WEAK)


def _spread(residual: Array) -> float:
    return float(1.4826 * np.median(np.abs(residual - np.median(residual))))

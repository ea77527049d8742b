"""Circles in space: through three points each, nearest to many, and how points deviate from one.

About a circle near the truth the radial deviations are dR + dC·r(phi), the axial ones dC·n - R dn·r(phi), dC, dn and
dR being what the circle is off by: two regressions on the same three columns 1, cos(phi), sin(phi).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.geometry.circle import CircleFrame, circle_frame
from analysis.kinematics.arm import Array

_ROUNDS = 8
"""Rounds of Gauss-Newton; points within a tenth of the radius take four to a nanometre."""


@dataclass(frozen=True)
class Deviations:
    """Deviations of n points from a circle: phi (n,) rad; radial, axial (n,) mm, outwards and along n."""

    phi: Array
    radial: Array
    axial: Array

    @property
    def design(self) -> Array:
        """Columns (n, 3) as shares: 1, cos(phi), sin(phi)."""
        return np.stack([np.ones_like(self.phi), np.cos(self.phi), np.sin(self.phi)], axis=1)

    @property
    def largest(self) -> Array:
        """The larger (n,) mm of both deviations, without sign."""
        return np.maximum(np.abs(self.radial), np.abs(self.axial))


def deviations(circle: CircleFrame, points: Array) -> Deviations:
    """How points (n, 3) mm deviate from a circle."""
    from_centre = points - circle.centre
    x, y = from_centre @ circle.u, from_centre @ circle.v
    return Deviations(np.arctan2(y, x), np.hypot(x, y) - circle.radius, from_centre @ circle.n)


def moved(circle: CircleFrame, radial: Array, axial: Array) -> CircleFrame:
    """The circle that its deviations ask for: coefficients (3,) mm of the radial and of the axial ones."""
    centre = circle.centre + axial[0] * circle.n + radial[1] * circle.u + radial[2] * circle.v
    n = circle.n - (axial[1] * circle.u + axial[2] * circle.v) / circle.radius
    return circle_frame(centre, n, circle.u, circle.radius + float(radial[0]))


def circles_through(points: Array) -> tuple[Array, Array, Array]:
    """Centre (k, 3) mm, unit normal (k, 3) and radius (k,) mm of the circles through points (k, 3, 3) mm, three each.

    Three points on a line give a circle of a radius beyond any arm."""
    a, b = points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]
    aa, bb = (a**2).sum(axis=1), (b**2).sum(axis=1)
    normal = np.cross(a, b)
    square = np.maximum((normal**2).sum(axis=1), 1e-12 * aa * bb + 1e-30)
    arm = np.cross(aa[:, None] * b - bb[:, None] * a, normal) / (2 * square[:, None])
    return points[:, 0] + arm, normal / np.sqrt(square)[:, None], np.linalg.norm(arm, axis=1)


def largest_deviations(points: Array, centre: Array, normal: Array, radius: Array) -> Array:
    """The larger deviation (k, n) mm, radial or axial and without sign, of points (n, 3) mm from k circles: centre
    (k, 3) mm, unit normal (k, 3), radius (k,) mm."""
    away = points[None] - centre[:, None]
    height = np.einsum("kni,ki->kn", away, normal)
    level = np.sqrt(np.maximum((away**2).sum(axis=2) - height**2, 0.0)) - radius[:, None]
    largest: Array = np.maximum(np.abs(height), np.abs(level))
    return largest


def nearest_circle(points: Array) -> CircleFrame | None:
    """The least-squares circle of points (n, 3) mm, three or more; None where they lie on a line or in one place."""
    middle = points.mean(axis=0)
    _, extent, V = np.linalg.svd(points - middle, full_matrices=False)
    if extent[1] < 1e-6 * extent[0] + 1e-9:
        return None
    # Kåsa's algebraic circle in the plane of the points to begin with.
    flat = (points - middle) @ V[:2].T
    square = (flat**2).sum(axis=1)
    x, y, c = np.linalg.lstsq(np.column_stack([2 * flat, np.ones(len(flat))]), square, rcond=None)[0]
    circle = circle_frame(middle + x * V[0] + y * V[1], V[2], V[0], float(np.sqrt(max(c + x * x + y * y, 1e-12))))
    for _ in range(_ROUNDS):
        away = deviations(circle, points)
        radial, axial = np.linalg.lstsq(away.design, np.stack([away.radial, away.axial], axis=1), rcond=None)[0].T
        if not circle.radius + radial[0] > 0:
            return None
        circle = moved(circle, radial, axial)
    return circle

"""Circles: the frame of the yaw and roll tests, nominal tool poses, circle angles, gauge readings of the ball link,
fitted circles, and deviations from a circle.

docs/conventions.md, "Circle test": P = C + R r(phi), z_T = -r, x_T = n, y_T = z_T × x_T (the acw tangent). The link's
disk is perpendicular to the line from the tool P to the ball B. A gauge at offset w along e reads along z_T to the
plane of the disk: g = (s - w (l·e)) / (l·z_T), with l the unit vector from P to B.

Peaks are those of `scipy.signal.find_peaks`, reimplemented because the import takes half a second, more than a
diagnosis of a small run.

For a circle close to the true one the radial deviations are dR + dC·r(phi), the axial ones dC·n - R dn·r(phi), with the
errors dC, dn and dR of the circle: two regressions on the same columns 1, cos(phi), sin(phi).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from analysis.robot.kinematics.arm import Arm, Array, Integers
from analysis.robot.kinematics.follow import follow
from rigs.schema.declared_tests import Circle
from rigs.schema.scene import play
from rigs.schema.vocabulary import CircleTest, Direction


def peaks(x: Array, prominence: float) -> Integers:
    """Rows of peaks of x (n,) that exceed their surroundings on both sides by `prominence`, in the unit of
    x.

    A flat top has its peak in the middle. Of several equal tops, the first counts.
    """
    # A follower in a gap moves down only after a fall by the whole gap.
    follower = np.diff(play(x, prominence / 2))
    moving = np.flatnonzero(follower)
    way = np.sign(follower[moving])
    rows = []
    for k in np.flatnonzero(np.diff(way) < 0):
        between = x[moving[k] : moving[k + 1] + 1]
        first = int(np.argmax(between))
        flat = int(np.argmax(np.append(between[first:] != between[first], True)))
        row = int(moving[k]) + first + (flat - 1) // 2
        # The gap starts in the middle, so half of it is sufficient for the first rise.
        if x[row] - x[:row].min() > prominence:
            rows.append(row)
    return np.array(rows, dtype=np.int64)


SENSE: dict[Direction, float] = {"acw": 1.0, "cw": -1.0}


@dataclass(frozen=True)
class CircleFrame:
    """centre (3,) mm; u, v, n: (3,) unit vectors, v = n × u; radius mm."""

    centre: Array
    u: Array
    v: Array
    n: Array
    radius: float

    def radial(self, phi: Array) -> Array:
        return np.cos(phi)[:, None] * self.u + np.sin(phi)[:, None] * self.v

    def direction(self, polar: Array, azimuth: Array) -> Array:
        """Unit vectors (k, 3) at polar angles from n and azimuths from u to v, both (k,) rad."""
        return np.cos(polar)[:, None] * self.n + np.sin(polar)[:, None] * self.radial(azimuth)

    def poses(self, phi: Array) -> Array:
        r = self.radial(phi)
        T = np.zeros((len(phi), 4, 4))
        T[:, :3, 0] = self.n
        T[:, :3, 1] = np.cross(-r, self.n)
        T[:, :3, 2] = -r
        T[:, :3, 3] = self.centre + self.radius * r
        T[:, 3, 3] = 1.0
        return T

    def angle(self, points: Array) -> Array:
        """Unwrapped circle angles (k,) rad of points (k, 3) mm in the world."""
        from_centre = points - self.centre
        return np.unwrap(np.arctan2(from_centre @ self.v, from_centre @ self.u))


def circle_frame(centre: Array, normal: Array, towards: Array, radius: float) -> CircleFrame:
    """A circle with a normal (3,) of any length; phi = 0 is the projected direction towards (3,)."""
    n = normal / np.linalg.norm(normal)
    u = towards - (towards @ n) * n
    u = u / np.linalg.norm(u)
    return CircleFrame(centre, u, np.cross(n, u), n, radius)


@lru_cache(maxsize=16)
def frame_of(circle: Circle) -> CircleFrame:
    return circle_frame(np.array(circle.centre_mm), np.array(circle.normal), np.array(circle.zero), circle.radius_mm)


@dataclass(frozen=True)
class Reversal:
    """Reversal of a joint (1 … 6) at circle angle phi (rad, 0 … 2 pi); upper: from rising to falling with increasing
    phi."""

    axis: int
    phi: float
    upper: bool


def reversals(circle: Circle, arm: Arm, where: str) -> list[Reversal]:
    """Joint reversals on the nominal circle, by axis and phi (Table 1 of the paper).

    A joint moving by less than 0.05° around the point counts as standing. Raises FileError if the arm cannot follow the
    circle; joint limits are checked for programs.
    """
    frame = frame_of(circle)
    # Beyond a lap at both ends, so that a reversal near the start has both flanks.
    step, first = np.radians(0.5), np.radians(circle.start_deg - circle.lead_deg)
    # Start posture of the programs; a joint may go a turn further here.
    posture = follow(arm, frame.poses(np.array([first])), np.radians(circle.posture_deg), where)[0]
    unlimited = replace(arm, limits=arm.limits + 2 * np.pi * np.array([-1.0, 1.0]))
    ahead, back = first + step * np.arange(800), first - step * np.arange(1, 80)
    q_ahead = follow(unlimited, frame.poses(ahead), posture, where)
    q_back = follow(unlimited, frame.poses(back), q_ahead[0], where)
    phi, q = np.concatenate([back[::-1], ahead]), np.concatenate([q_back[::-1], q_ahead])
    turns = []
    for axis, joint in enumerate(q.T, start=1):
        for sign in (1.0, -1.0):
            for k in peaks(sign * joint, float(np.radians(0.05))):
                c = np.polyfit(phi[k - 1 : k + 2] - phi[k], joint[k - 1 : k + 2], 2)
                vertex = phi[k] - c[1] / (2 * c[0])
                if first <= vertex < first + 2 * np.pi:
                    turns.append(Reversal(axis, float(vertex % (2 * np.pi)), sign > 0))
    return sorted(turns, key=lambda turn: (turn.axis, turn.phi))


_ROUNDS = 8
"""Rounds of Gauss-Newton; points within a tenth of the radius need four to reach a nanometre."""


@dataclass(frozen=True)
class Deviations:
    """Deviations of n points from a circle: phi (n,) rad; radial, axial (n,) mm, outwards and along n."""

    phi: Array
    radial: Array
    axial: Array

    @property
    def design(self) -> Array:
        return np.stack([np.ones_like(self.phi), np.cos(self.phi), np.sin(self.phi)], axis=1)

    @property
    def largest(self) -> Array:
        return np.maximum(np.abs(self.radial), np.abs(self.axial))


def deviations(circle: CircleFrame, points: Array) -> Deviations:
    from_centre = points - circle.centre
    x, y = from_centre @ circle.u, from_centre @ circle.v
    return Deviations(np.arctan2(y, x), np.hypot(x, y) - circle.radius, from_centre @ circle.n)


def moved(circle: CircleFrame, radial: Array, axial: Array) -> CircleFrame:
    """Circle corrected by regression coefficients (3,) mm of the radial and axial deviations."""
    centre = circle.centre + axial[0] * circle.n + radial[1] * circle.u + radial[2] * circle.v
    n = circle.n - (axial[1] * circle.u + axial[2] * circle.v) / circle.radius
    return circle_frame(centre, n, circle.u, circle.radius + float(radial[0]))


def circles_through(points: Array) -> tuple[Array, Array, Array]:
    """Centre (k, 3), unit normal (k, 3) and radius (k,) mm of circles through points (k, 3, 3) mm, three each.

    Collinear points give a radius beyond any arm.
    """
    a, b = points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]
    aa, bb = (a**2).sum(axis=1), (b**2).sum(axis=1)
    normal = np.cross(a, b)
    square = np.maximum((normal**2).sum(axis=1), 1e-12 * aa * bb + 1e-30)
    arm = np.cross(aa[:, None] * b - bb[:, None] * a, normal) / (2 * square[:, None])
    return points[:, 0] + arm, normal / np.sqrt(square)[:, None], np.linalg.norm(arm, axis=1)


def largest_deviations(points: Array, centre: Array, normal: Array, radius: Array) -> Array:
    """Larger absolute deviation (k, n) mm, radial or axial, of points (n, 3) mm from k circles."""
    away = points[None] - centre[:, None]
    height = np.einsum("kni,ki->kn", away, normal)
    level = np.sqrt(np.maximum((away**2).sum(axis=2) - height**2, 0.0)) - radius[:, None]
    return np.asarray(np.maximum(np.abs(height), np.abs(level)))


def nearest_circle(points: Array) -> CircleFrame | None:
    """Least-squares circle of points (n, 3) mm; None for collinear or equal points."""
    middle = points.mean(axis=0)
    _, extent, V = np.linalg.svd(points - middle, full_matrices=False)
    if extent[1] < 1e-6 * extent[0] + 1e-9:
        return None
    # start value: Kåsa's algebraic circle in the plane of the points
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


BASELINE_AXIS: dict[str, int] = {"yaw": 1, "roll": 0}
"""Column of the tool frame along the gauge baseline: y_T for yaw, x_T for roll."""


def link_readings(
    T: Array, ball: Array, offsets_mm: Array, test: CircleTest, link_mm: float, form_mm: Array | float = 0.0
) -> Array:
    """Gauge readings (n, k) mm, before zero setting, of gauges at `offsets_mm` (k,) along the baseline.

    T (n, 4, 4): link-side tool poses; link_mm: subtracted from |B - P|; form_mm (n,): added to the distance.
    """
    to_ball = ball - T[:, :3, 3]
    distance = np.sqrt(np.einsum("ni,ni->n", to_ball, to_ball))
    # products with the whole line to the ball, whose length is common to all terms
    along_e = np.einsum("ni,ni->n", to_ball, T[:, :3, BASELINE_AXIS[test]])
    along_z = np.einsum("ni,ni->n", to_ball, T[:, :3, 2])
    radial = (distance - link_mm + form_mm) * distance
    return np.asarray((radial[:, None] - along_e[:, None] * offsets_mm) / along_z[:, None])


def link_angle(g1: Array, g2: Array, baseline_mm: float) -> Array:
    """Angle (n,) rad between disk and tool from two readings (n,) mm: atan((g2 - g1) / b)."""
    return np.arctan((g2 - g1) / baseline_mm)

"""The ball link: circles of yaw and roll and the hemisphere, as docs/method.md defines them; mm, rad."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tests.worlds.unknown.arms import Arm, Array, UnreachableError, inverse
from tests.worlds.unknown.motion import Motion, lap

LEAD_RAD = np.radians(12.0)
SPEED_MM_S = 25.0
BASELINE_MM = 50.0
KNOTS = 181


@dataclass(frozen=True)
class Circle:
    """Circle of the shipped UR10e example: centre (3,) mm, normal (3,), radius, and start posture."""

    centre: Array = field(default_factory=lambda: np.array([-650.0, -200.0, 250.0]))
    normal: Array = field(default_factory=lambda: np.array([0.15, 0.1, 1.0]))
    radius: float = 70.0
    posture: Array = field(default_factory=lambda: np.radians([2, -75.3, 101.4, 55.2, 84.6, 107.8]))

    def basis(self) -> tuple[Array, Array, Array]:
        """Unit vectors u (towards x), v and the normal."""
        n = self.normal / np.linalg.norm(self.normal)
        u = np.array([1.0, 0, 0]) - n[0] * n
        u /= np.linalg.norm(u)
        return u, np.cross(n, u), n

    def frames(self, phi: Array) -> Array:
        """Return tool frames (n, 4, 4): origin on the circle, z towards the centre, x along the normal."""
        u, v, n = self.basis()
        r = np.cos(phi)[:, None] * u + np.sin(phi)[:, None] * v
        x = np.broadcast_to(n, r.shape)
        T = np.tile(np.eye(4), (len(r), 1, 1))
        T[:, :3, :3] = np.stack([x, np.cross(-r, x), -r], axis=2)
        T[:, :3, 3] = self.centre + self.radius * r
        return T


@dataclass(frozen=True)
class Hemisphere:
    """Hemisphere of the shipped UR10e example."""

    centre: Array = field(default_factory=lambda: np.array([-800.0, -200.0, 0.0]))
    radius: float = 400.0
    posture: Array = field(default_factory=lambda: np.radians([3.0, -86, 115, -28, 93, -90]))


TOOL = np.array([[0.0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 150], [0, 0, 0, 1]])
"""Tool frame: 150 mm along the z axis of the flange, turned by 90 degrees about y, so the link points sideways."""


def circle_path(arm: Arm, circle: Circle) -> tuple[Array, Array]:
    """Joints (k, 6) of an anticlockwise circle with lead-in and lead-out, and their angles phi (k,)."""
    phi = np.linspace(-LEAD_RAD, 2 * np.pi + LEAD_RAD, KNOTS)
    frames = circle.frames(phi)
    q, now = [], circle.posture[None]
    for k in range(KNOTS):
        now = inverse(arm, frames[k : k + 1], TOOL, now)
        q.append(now[0])
    return np.array(q), phi


def circle_motion(path: tuple[Array, Array], sense: int, begin_s: float, rate_hz: float) -> Motion:
    """Drive a single circle at the usual speed."""
    return lap(*path, sense, 2 * np.pi * Circle().radius / SPEED_MM_S, begin_s, rate_hz)


@dataclass(frozen=True)
class Targets:
    """Hemisphere targets within reach: number, polar, azimuth (rad), orientation, q (m, 6)."""

    number: Array
    polar: Array
    azimuth: Array
    orientation: Array
    q: Array


def hemisphere_targets(arm: Arm, place: Hemisphere) -> Targets:
    """Find the postures of 37 targets (every 30 degrees) in three tool orientations, if within reach."""
    places = [(0.0, 0.0)] + [(30.0 * ring, 30.0 * k) for ring in (1, 2, 3) for k in range(12)]
    rows, q, now = [], [], place.posture
    for number, (polar, azimuth) in enumerate(np.radians(places), start=1):
        for orientation in (1, 2, 3):
            T = _target_frame(place, polar, azimuth, np.radians(20.0) * (orientation - 2))
            for start in (place.posture, now):
                try:
                    now = inverse(arm, T[None], TOOL, start[None])[0]
                except UnreachableError:
                    continue
                rows.append((number, polar, azimuth, orientation))
                q.append(now)
                break
    number, polars, azimuths, orientations = np.array(rows).T
    return Targets(number, polars, azimuths, orientations, np.array(q))


def _target_frame(place: Hemisphere, polar: float, azimuth: float, tilt: float) -> Array:
    """Tool frame (4, 4) at a target: it leans halfway to the radius and is tilted about its x axis."""
    out = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    z = -(np.cos(polar / 2) * up + np.sin(polar / 2) * out)
    x = np.array([1.0, 0.0, 0.0])
    x -= (x @ z) * z
    x /= np.linalg.norm(x)
    y = np.cross(z, x)
    c, s = np.cos(tilt), np.sin(tilt)
    T = np.eye(4)
    T[:3, :3] = np.stack([x, c * y + s * z, c * z - s * y], axis=1)
    T[:3, 3] = place.centre + place.radius * (np.cos(polar) * up + np.sin(polar) * out)
    return T


@dataclass(frozen=True)
class Link:
    """The set-up: ball (3,) mm in the base frame, and zeros (2,) mm of the gauges."""

    ball: Array
    zeros: Array


def gauge_readings(tool: Array, link: Link, radius: float, test: str) -> Array:
    """Return gauge readings (n, 2) mm for tools (n, 4, 4), or (n, 1) for the radial test."""
    way = link.ball - tool[:, :3, 3]
    distance = np.linalg.norm(way, axis=1)
    line = way / distance[:, None]
    s = distance - radius
    if test == "radial":
        return (s - link.zeros[0])[:, None]
    across = tool[:, :3, 1 if test == "yaw" else 0]
    half = BASELINE_MM / 2
    to_e, to_z = np.einsum("ni,ni->n", line, across), np.einsum("ni,ni->n", line, tool[:, :3, 2])
    g = (s[:, None] - to_e[:, None] * np.array([half, -half])) / to_z[:, None]
    return np.asarray(g - link.zeros)

"""Closed surfaces of turned parts and of a bar with two holes, as STL.

Built ring by ring, so every edge belongs to exactly two triangles. Lengths are in mm, z up from the bed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Faces = NDArray[np.int64]
Profile = Sequence[tuple[float, float]]

SEGMENTS = 128
"""A cone seat of a ball of 20 mm is then round to within 2 µm."""
_HEADER = b"rig parts, mm".ljust(80)
_ON_AXIS = 1e-9


@dataclass(frozen=True)
class Solid:
    """Corners (n, 3) mm, and faces (m, 3) of corner indices, counterclockwise from outside."""

    corners: Array
    faces: Faces

    @property
    def triangles(self) -> Array:
        return np.asarray(self.corners[self.faces])

    @property
    def volume_mm3(self) -> float:
        a, b, c = self.triangles.transpose(1, 0, 2)
        return float((a * np.cross(b, c)).sum() / 6)

    def stl(self) -> bytes:
        triangles = self.triangles
        normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        records = np.zeros(len(triangles), dtype=[("sides", "<f4", (4, 3)), ("attribute", "<u2")])
        records["sides"][:, 0] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        records["sides"][:, 1:] = triangles
        return _HEADER + np.uint32(len(triangles)).tobytes() + records.tobytes()


def turned(profile: Profile) -> Solid:
    """Revolve a section, downwards on the outside; a body if it starts and ends on the axis, else a ring."""
    angles = 2 * np.pi * np.arange(SEGMENTS) / SEGMENTS
    rings = [
        np.column_stack([radius * np.cos(angles), radius * np.sin(angles), np.full(SEGMENTS, height)])
        for radius, height in profile
    ]
    is_ring = profile[0][0] > _ON_AXIS
    pairs = [*pairwise(rings), *([(rings[-1], rings[0])] if is_ring else [])]
    return _joined([face for upper, lower in pairs for face in _band(upper, lower)])


def bar(hole: Profile, apart_mm: float, beyond_mm: float) -> Solid:
    """hole: radii and heights, from the top down. apart_mm: of the axes. beyond_mm: past each axis."""
    # Build the half of the bar with the hole at the origin, open at the cut x = to_cut, as triangles (m, 3, 3).
    to_cut = apart_mm / 2
    corners = np.arctan2([beyond_mm, beyond_mm, -beyond_mm, -beyond_mm], [to_cut, -beyond_mm, -beyond_mm, to_cut])
    angles = np.unique(np.concatenate([2 * np.pi * np.arange(SEGMENTS) / SEGMENTS - np.pi, corners]).round(12))
    way = np.column_stack([np.cos(angles), np.sin(angles)])
    with np.errstate(divide="ignore"):
        length = np.minimum(np.where(way[:, 0] > 0, to_cut, -beyond_mm) / way[:, 0], beyond_mm / np.abs(way[:, 1]))
    edge = way * length[:, None]
    top, bottom = hole[0][1], hole[-1][1]

    def at(places: Array, height: float) -> Array:
        return np.column_stack([places, np.full(len(places), height)])

    rings = [at(way * radius, height) for radius, height in hole]
    faces = _band(at(edge, bottom), rings[-1]) + _band(rings[0], at(edge, top))
    for upper, lower in pairwise(rings):
        faces += _band(lower, upper)
    is_cut = np.isclose(edge[:, 0], to_cut)
    open_side = is_cut & np.roll(is_cut, -1)
    walls = np.array(_band(at(edge, top), at(edge, bottom))).reshape(-1, 3, 3)
    half = np.concatenate([np.array(faces), walls[~np.repeat(open_side, 2)]])
    mirrored = half[:, ::-1] * [-1, 1, 1]
    moved = np.array([apart_mm / 2, 0, 0])
    return _joined([*(half - moved), *(mirrored + moved)])


def _band(upper: Array, lower: Array) -> list[Array]:
    """Two triangles (3, 3) per side of two rings (n, 3), degenerate at radius 0."""
    after_upper, after_lower = np.roll(upper, -1, axis=0), np.roll(lower, -1, axis=0)
    quads = zip(upper, lower, after_lower, after_upper, strict=True)
    return [triangle for a, b, c, d in quads for triangle in (np.array([a, b, c]), np.array([a, c, d]))]


def _joined(triangles: Sequence[Array]) -> Solid:
    all_corners = np.array(triangles).reshape(-1, 3).round(9) + 0.0
    corners, numbers = np.unique(all_corners, axis=0, return_inverse=True)
    faces = numbers.reshape(-1, 3)
    distinct = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    return Solid(corners, faces[distinct])

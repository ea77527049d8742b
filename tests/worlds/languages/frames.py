"""Frames in the notation of the five languages, computed with plain floats for speed.

A program is executed along twenty paths before and after a correction, with the same numbers in its text. Frames are
therefore cached, and read-only because they are shared.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from tests.worlds.languages.arms import Array, placed, turn_of

_MOST = 20_000
_UPRIGHT = 1e-7
"""Cosine of the pitch below which the other two angles are ambiguous."""


def _made(rows: list[list[float]], place: tuple[float, ...]) -> Array:
    T = np.array([[*row, at] for row, at in zip(rows, place, strict=True)] + [[0.0, 0.0, 0.0, 1.0]])
    T.setflags(write=False)
    return T


@lru_cache(maxsize=_MOST)
def of_angles(x: float, y: float, z: float, roll: float, pitch: float, yaw: float) -> Array:
    """A frame (4, 4) from mm and degrees, by rotations about fixed x, y, z (or about z, new y, new x)."""
    (cr, sr), (cp, sp), (cy, sy) = (
        (math.cos(angle), math.sin(angle)) for angle in (math.radians(deg) for deg in (roll, pitch, yaw))
    )
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return _made(rows, (x, y, z))


def angles_of(T: Array) -> tuple[float, ...]:
    """Return x, y, z in mm and roll, pitch, yaw in degrees of a frame (4, 4)."""
    (xx, _, _, x), (xy, _, _, y), (xz, yz, zz, z), _ = T.tolist()
    along = math.hypot(xx, xy)
    if along < _UPRIGHT:
        return (x, y, z, *Rotation.from_matrix(T[:3, :3]).as_euler("xyz", degrees=True).tolist())
    return (x, y, z, *map(math.degrees, (math.atan2(yz, zz), math.atan2(-xz, along), math.atan2(xy, xx))))


@lru_cache(maxsize=_MOST)
def of_quaternion(x: float, y: float, z: float, q1: float, q2: float, q3: float, q4: float) -> Array:
    """A frame (4, 4) from mm and a quaternion, scalar first. Raises ValueError for a zero quaternion."""
    return _made(Rotation.from_quat([q1, q2, q3, q4], scalar_first=True).as_matrix().tolist(), (x, y, z))


def quaternion_of(T: Array) -> list[float]:
    """Quaternion of a frame (4, 4), the scalar first."""
    return list(_quaternion(T[:3, :3].tobytes()))


@lru_cache(maxsize=_MOST)
def _quaternion(R: bytes) -> tuple[float, ...]:
    turn = Rotation.from_matrix(np.frombuffer(R).reshape(3, 3))
    return tuple(turn.as_quat(scalar_first=True).tolist())


@lru_cache(maxsize=_MOST)
def of_vector(x: float, y: float, z: float, rx: float, ry: float, rz: float) -> Array:
    """A frame (4, 4) of mm and a rotation vector in rad."""
    return _made(Rotation.from_rotvec([rx, ry, rz]).as_matrix().tolist(), (x, y, z))


def vector_of(T: Array) -> list[float]:
    """Rotation vector in rad of a frame (4, 4)."""
    return turn_of(T[:3, :3]).tolist()  # type: ignore[no-any-return]


def inverted(T: Array) -> Array:
    """Inverse (4, 4) of a frame."""
    R = T[:3, :3].T
    return placed(-R @ T[:3, 3], R)


def moved(X: Array, step: Array) -> Array:
    """A frame X (4, 4) shifted and turned on the spot by a step (4, 4), both in the same reference."""
    return placed(X[:3, 3] + step[:3, 3], step[:3, :3] @ X[:3, :3])


def shifted(F: Array, y: float) -> Array:
    """A frame (4, 4) moved along y by mm, as by a rail; for 0 the same object."""
    if not y:
        return F
    moved = np.array(F)
    moved[1, 3] += y
    return moved

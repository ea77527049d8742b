"""Eight branches in closed form, for the two kinds of arm in `canonical`.

With R = RotX(90°) and every sign taken out, the arm is Rz(t1) TransX(a1) R, then a chain in the plane of
its arm, then the wrist. A point of the plane is a complex number; the plane's normal is -y of frame 1.
Both kinds are made of the same three parts:

- shoulder: the wrist centre's distance from the plane is known, D = the sum of the offsets along the
  parallel axes, so -x sin t1 + y cos t1 = -D: two t1;
- elbow: u + iv = L e^(i t2) + w e^(i (t2 + t3)), two links in the plane: two (t2, t3);
- wrist: M = Rz(t4) R Rz(t5) R Rz(t6), from which M22 = -cos t5; t4 is in its column 2: two (t4, t5, t6).

Spherical wrist: shoulder, elbow with w = a3 - i d4, wrist. Parallel axes: shoulder, wrist with
t2 + t3 + t4 in place of t4, elbow with w = a3 after a4 - i d5 is taken off. Derived for this program
(J. Craig, Introduction to Robotics, 3rd ed., ch. 4 for the method; M. Brandstötter et al. 2014 and
K. Hawkins 2013 have the same branches in other parameters).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.kinematics.arm import Array
from analysis.kinematics.canonical import Canonical

Complex = NDArray[np.complex128]

_BOTH = np.array([1.0, -1.0])
_ON_AXIS_MM = 1e-9
_WRIST_SINGULAR = 1e-12
"""sin t5 below which t4 is chosen: what that moves the tool by is far below every tolerance."""


def branches(form: Canonical, poses: Array, spread: float = 0.0) -> Array:
    """theta (n, 8, 6) rad of the arm for tool poses (n, 4, 4) in the world, not wrapped.

    Slot = 4 · shoulder + 2 · elbow + wrist. A branch out of reach is not marked: its angles come as near as
    the arm does, and forward kinematics decides. With `spread` > 0 (rad) the two sides of a singularity are
    held that far apart: seeds for an arm that is only near its kind.

    Singular poses: a wrist centre on axis 1 has t1 = 0 and 180°; t5 = 0 has t4 = 0 (spherical wrist), or the
    t2 + t3 + t4 that brings the elbow nearest to a right angle (parallel axes). Other splits exist.
    """
    T = form.T_one_world @ poses @ form.T_tool_wrist
    solve = _spherical_wrist if form.kind == "spherical wrist" else _parallel_axes
    theta = np.stack(np.broadcast_arrays(*solve(form, T, spread)), axis=-1)
    return theta.reshape(len(poses), 8, 6) * form.sign


def _spherical_wrist(form: Canonical, T: Array, spread: float) -> list[Array]:
    """t1 … t6, each to broadcast to (n, shoulder, elbow, wrist)."""
    a, d = form.a, form.d
    t1, u = _shoulder(T, d[1] + d[2])
    t2, t3 = _elbow(u - a[1] + 1j * T[:, 2, 3, None], a[2], a[3] - 1j * d[3], spread)
    M = _down(t2 + t3, _down(t1, T[:, None, :3, :3])[:, :, None])
    t4, t5, t6 = _wrist(M, np.zeros(t2.shape), spread)
    return [t1[:, :, None, None], t2[..., None], t3[..., None], t4, t5, t6]


def _parallel_axes(form: Canonical, T: Array, spread: float) -> list[Array]:
    """t1 … t6, each to broadcast to (n, shoulder, elbow, wrist)."""
    a, d = form.a, form.d
    t1, u = _shoulder(T, d[1] + d[2] + d[3])
    centre, hand = u - a[1] + 1j * T[:, 2, 3, None], complex(a[4], -d[4])
    t234, t5, t6 = _wrist(_down(t1, T[:, None, :3, :3]), _bent(centre, hand, a[2], a[3]), spread)
    t2, t3 = _elbow(centre[..., None] - hand * np.exp(1j * t234), a[2], complex(a[3]), spread)
    t2, t3 = np.swapaxes(t2, 2, 3), np.swapaxes(t3, 2, 3)
    return [t1[:, :, None, None], t2, t3, t234[:, :, None] - t2 - t3, t5[:, :, None], t6[:, :, None]]


def _shoulder(T: Array, off_plane: float) -> tuple[Array, Array]:
    """t1 (n, 2) and the wrist centre's distance from axis 1 within the plane (n, 2)."""
    x, y = T[:, 0, 3], T[:, 1, 3]
    r = np.hypot(x, y)
    bearing = np.where(r < _ON_AXIS_MM, 0.0, np.arctan2(y, x))
    u = np.sqrt(np.maximum((r - off_plane) * (r + off_plane), 0.0))[:, None] * _BOTH
    return bearing[:, None] - np.arctan2(-off_plane, u), u


def _elbow(target: Complex, upper: float, forearm: complex, spread: float) -> tuple[Array, Array]:
    """t2 and t3 (…, 2): two links in the plane whose end is at target (…)."""
    length = abs(forearm)
    cosine = (np.abs(target) ** 2 - upper**2 - length**2) / (2 * upper * length)
    widest = np.cos(spread)
    bend = np.arccos(np.clip(cosine, -widest, widest))[..., None] * _BOTH
    t2 = np.angle(target)[..., None] - np.angle(upper + length * np.exp(1j * bend))
    return t2, bend - np.angle(forearm)


def _wrist(M: Array, free: Array, spread: float) -> tuple[Array, Array, Array]:
    """t4, t5, t6 (…, 2) of rotations M (…, 3, 3); t4 is `free` (…) where the wrist is singular."""
    sine = np.hypot(M[..., 0, 2], M[..., 1, 2])
    t4 = np.where(sine < _WRIST_SINGULAR, free, np.arctan2(M[..., 1, 2], M[..., 0, 2]))
    flipped = np.where(sine < _WRIST_SINGULAR, 0.0, np.pi)
    t4 = np.stack([t4, t4 + flipped], axis=-1)
    t5 = np.arctan2(np.maximum(sine, np.sin(spread)), -M[..., 2, 2])[..., None] * _BOTH
    # From t4 and the second row, well-conditioned however small sin t5 is.
    row = np.sin(t4)[..., None] * M[..., None, 0, :2] - np.cos(t4)[..., None] * M[..., None, 1, :2]
    return t4, t5, np.arctan2(row[..., 0], row[..., 1])


def _down(t: Array, M: Array) -> Array:
    """RotX(-90°) Rz(-t) M for t (…) and rotations M (…, 3, 3)."""
    c, s = np.cos(t)[..., None], np.sin(t)[..., None]
    x, y, z = M[..., 0, :], M[..., 1, :], M[..., 2, :]
    return np.stack(np.broadcast_arrays(c * x + s * y, z, s * x - c * y), axis=-2)


def _bent(centre: Complex, hand: complex, upper: float, forearm: float) -> Array:
    """Direction (…) rad of the hand that brings the elbow nearest to a right angle."""
    wanted = upper**2 + forearm**2
    reach = 2 * np.abs(centre) * abs(hand)
    cosine = (np.abs(centre) ** 2 + abs(hand) ** 2 - wanted) / np.where(reach > 0, reach, 1.0)
    angle: Array = np.angle(centre) + np.arccos(np.clip(cosine, -1.0, 1.0)) - np.angle(hand)
    return angle

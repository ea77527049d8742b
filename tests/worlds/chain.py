"""Arms of the worlds as chains of links, multiplied out in modified Denavit-Hartenberg; nothing here is of rig."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
G_M_S2 = 9.81


def link_frames(a: ArrayLike, alpha: ArrayLike, beta: ArrayLike, d: ArrayLike, theta: Array) -> tuple[Array, Array]:
    """Rotations (n, k, 3, 3) and origins (n, k, 3) mm of the links.

    A link is RotX(alpha) TransX(a) RotY(beta) RotZ(theta) TransZ(d). Lengths (k,) in mm, angles in rad; beta is
    Hayati's angle between parallel axes.
    """
    count, axes = theta.shape
    R, p = np.tile(np.eye(3), (count, axes, 1, 1)), np.zeros((count, axes, 3))
    turn, place = np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))
    lengths, offsets = np.broadcast_to(a, axes), np.broadcast_to(d, axes)
    tilts = Rotation.from_euler("XY", np.stack(np.broadcast_arrays(alpha, beta), axis=1)).as_matrix()
    for k in range(axes):
        place = place + turn[:, :, 0] * lengths[k]
        turn = turn @ tilts[k] @ Rotation.from_euler("z", theta[:, k, None]).as_matrix()
        place = place + turn[:, :, 2] * offsets[k]
        R[:, k], p[:, k] = turn, place
    return R, p


def gravity_torques(R: Array, p: Array, masses: ArrayLike, centres: ArrayLike, up: ArrayLike = (0, 0, 1)) -> Array:
    """Torque of gravity (n, k) Nm on each joint: masses (k,) kg at centres (k, 3) mm in their links, up in the base."""
    at = p + np.einsum("nkij,kj->nki", R, np.asarray(centres, dtype=float))
    force = -G_M_S2 * np.asarray(masses, dtype=float)[:, None] * np.asarray(up, dtype=float)
    torque = np.zeros(p.shape[:2])
    for joint in range(p.shape[1]):
        lever = (at[:, joint:] - p[:, None, joint]) / 1000
        torque[:, joint] = (np.cross(lever, force[joint:]).sum(axis=1) * R[:, joint, :, 2]).sum(axis=1)
    return torque

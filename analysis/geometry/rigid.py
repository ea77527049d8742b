"""Rigid motions: the best fit between two sets of points, and small changes of a frame."""

from __future__ import annotations

import numpy as np

from analysis.kinematics.arm import Array


def best_rigid(points: Array, targets: Array) -> Array:
    """Return T (4, 4) that maps points (n, 3) mm to targets (n, 3) mm with least squares (Kabsch 1976)."""
    middle, goal = points.mean(axis=0), targets.mean(axis=0)
    u, _, vt = np.linalg.svd((points - middle).T @ (targets - goal))
    flip = np.diag([1.0, 1.0, np.linalg.det(vt.T @ u.T)])
    T = np.eye(4)
    T[:3, :3] = vt.T @ flip @ u.T
    T[:3, 3] = goal - T[:3, :3] @ middle
    return T


def in_frame(T: Array, points: Array) -> Array:
    """Return points (n, 3) mm as the frame T (4, 4), in mm, puts them."""
    moved: Array = points @ T[:3, :3].T + T[:3, 3]
    return moved


def moved_by(T: Array, shift: Array, turn: Array) -> Array:
    """Return a frame T (4, 4) shifted by (3,) mm and rotated by a rotation vector (3,) rad about its own origin."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import, needed here only

    moved = T.copy()
    moved[:3, :3] = Rotation.from_rotvec(turn).as_matrix() @ T[:3, :3]
    moved[:3, 3] += shift
    return moved

"""Where the tracker stood and where its target sat on the tool: least squares over the places of poses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.geometry.rigid import best_rigid
from analysis.kinematics.arm import Array

_STEPS = 100
"""Largest number of steps of Levenberg and Marquardt. Chosen: right arms need five, wrong ones forty."""
_CONVERGED = 1e-12
"""Relative change of the misfit below which it is the least, as near as numbers hold it."""
_LEAST_DAMPING, _MOST_DAMPING = 1e-12, 1e6


@dataclass(frozen=True)
class PoseSetUp:
    """T_world_base and T_flange_tool (4, 4), fitted; the world is the tracker's."""

    T_world_base: Array
    T_flange_tool: Array
    design: Array
    """Slopes (3 n, 9) mm of the errors by base turn and place and tool place, at the solution."""


def fit_setup(T: Array, xyz_mm: Array, steps: int = _STEPS) -> PoseSetUp:
    """Return base and tool that bring the flanges T (n, 4, 4) of the bare arm to the places xyz_mm (n, 3), by at most
    so many steps."""
    start = best_rigid(T[:, :3, 3], xyz_mm)
    reach = float(np.linalg.norm(T[:, :3, 3], axis=1).max()) or 1.0
    R, origin, tool = start[:3, :3], start[:3, 3], np.zeros(3)
    residual = _left(T, xyz_mm, R, origin, tool)
    damping = 1e-6
    for _ in range(steps):
        design = _design(T, R, tool, reach)
        normal, gradient = design.T @ design, design.T @ residual
        while damping < _MOST_DAMPING:
            damped = normal + damping * np.diag(np.maximum(np.diag(normal), 1e-9))
            step = np.asarray(-np.linalg.solve(damped, gradient), dtype=float)
            tried = (_turn(step[:3] / reach) @ R, origin + step[3:6], tool + step[6:])
            new = _left(T, xyz_mm, *tried)
            if new @ new <= residual @ residual:
                break
            damping *= 10
        else:
            break
        gained = residual @ residual - new @ new
        R, origin, tool = tried
        residual = new
        damping = max(damping / 10, _LEAST_DAMPING)
        if gained <= _CONVERGED * (residual @ residual):
            break
    return PoseSetUp(frame(R, origin), frame(np.eye(3), tool), _design(T, R, tool, reach))


def position_error(T: Array, xyz_mm: Array, setup: PoseSetUp) -> Array:
    """Return the position errors (n, 3) mm, measured less fitted, in the arm's base, of flanges T (n, 4, 4) of the bare
    arm at the measured places xyz_mm (n, 3)."""
    base = setup.T_world_base
    tool = T[:, :3, 3] + T[:, :3, :3] @ setup.T_flange_tool[:3, 3]
    error: Array = (xyz_mm - base[:3, 3]) @ base[:3, :3] - tool
    return error


def frame(R: Array, origin: Array) -> Array:
    """Return the frame (4, 4) of a rotation (3, 3) and an origin (3,) mm."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, origin
    return T


def _left(T: Array, xyz_mm: Array, R: Array, origin: Array, tool: Array) -> Array:
    """What is left (3 n,) mm of places beside a base and a tool."""
    values: Array = xyz_mm - ((T[:, :3, 3] + T[:, :3, :3] @ tool) @ R.T + origin)
    return values.ravel()


def _design(T: Array, R: Array, tool: Array, reach: float) -> Array:
    """Slopes (3 n, 9) mm of what is left, by the base's turn at `reach` mm, its place and the tool's."""
    x, y, z = ((T[:, :3, 3] + T[:, :3, :3] @ tool) @ R.T).T
    none = np.zeros_like(x)
    turn = np.stack([none, -z, y, z, none, -x, -y, x, none], axis=1).reshape(-1, 3, 3) / reach
    place = np.tile(-np.eye(3), (len(T), 1, 1))
    slopes: Array = np.concatenate([turn, place, -R @ T[:, :3, :3]], axis=2)
    return slopes.reshape(-1, 9)


def _turn(vector: Array) -> Array:
    """The rotation (3, 3) by a rotation vector (3,) rad (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector / angle if angle > 0 else vector
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K)

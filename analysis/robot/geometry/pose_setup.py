"""Least-squares fits to measured positions: tracker frame and target, ball and sockets, or all constants of an arm.

All fits consist of rigid motions between point sets and small changes of a frame.

The unknown constants are a, alpha, beta, d and zero of each axis, the instrument frame, and the target position;
undetermined combinations keep their nominal values or move least (Marquardt). Positions computed by a controller are
reproduced to the last digit, unlike measured ones.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.robot.kinematics.arm import Arm, Array, Integers, forward, rotation


def socket_design(T: Array, socket: Integers, sockets: int) -> Array:
    """Derivatives (3 n, 3 + 3 s) of the ball's distance from its socket by ball and socket positions."""
    design = np.zeros((len(T), 3, 3 + 3 * sockets))
    design[:, :, :3] = T[:, :3, :3]
    for axis in range(3):
        design[np.arange(len(T)), axis, 3 + 3 * socket + axis] = -1.0
    return design.reshape(3 * len(T), -1)


def socket_residuals(T: Array, names: NDArray[np.str_]) -> Array:
    """Residuals (n, 3) mm of the ball relative to its socket, with fitted positions of both."""
    sockets, socket = np.unique(names, return_inverse=True)
    design, seen = socket_design(T, socket.ravel(), len(sockets)), -T[:, :3, 3].ravel()
    return np.asarray((design @ np.linalg.lstsq(design, seen)[0] - seen).reshape(-1, 3))


def best_rigid(points: Array, targets: Array) -> Array:
    """T (4, 4) that maps points (n, 3) to targets (n, 3) in the least-squares sense (Kabsch 1976)."""
    middle, goal = points.mean(axis=0), targets.mean(axis=0)
    u, _, vt = np.linalg.svd((points - middle).T @ (targets - goal))
    flip = np.diag([1.0, 1.0, np.linalg.det(vt.T @ u.T)])
    T = np.eye(4)
    T[:3, :3] = vt.T @ flip @ u.T
    T[:3, 3] = goal - T[:3, :3] @ middle
    return T


def in_frame(T: Array, points: Array) -> Array:
    return np.asarray(points @ T[:3, :3].T + T[:3, 3])


def moved_by(T: Array, shift: Array, turn: Array) -> Array:
    """A frame shifted by (3,) mm and rotated by a rotation vector (3,) rad about its own origin."""
    moved = T.copy()
    moved[:3, :3] = rotation(turn) @ T[:3, :3]
    moved[:3, 3] += shift
    return moved


_STEPS = 100
"""Limit of Levenberg-Marquardt steps. Chosen: correct arms need five, wrong ones forty."""
_CONVERGED = 1e-12
"""Relative change of the misfit at convergence, close to the rounding of the numbers."""
_LEAST_DAMPING, _MOST_DAMPING = 1e-12, 1e6


@dataclass(frozen=True)
class PoseSetUp:
    """Fitted T_world_base and T_flange_tool (4, 4); the world is the tracker's frame."""

    T_world_base: Array
    T_flange_tool: Array
    design: Array
    """Derivatives (3 n, 9) mm of the errors by base rotation, base position and tool position, at the solution."""


def fit_setup(T: Array, xyz_mm: Array, steps: int = _STEPS) -> PoseSetUp:
    """Base and tool that map the flanges T (n, 4, 4) of the bare arm to positions xyz_mm (n, 3)."""
    start = best_rigid(T[:, :3, 3], xyz_mm)
    reach = float(np.linalg.norm(T[:, :3, 3], axis=1).max()) or 1.0
    R, origin, tool = start[:3, :3], start[:3, 3], np.zeros(3)
    residual = _position_residuals(T, xyz_mm, R, origin, tool)
    damping = 1e-6
    for _ in range(steps):
        design = _design(T, R, tool, reach)
        normal, gradient = design.T @ design, design.T @ residual
        while damping < _MOST_DAMPING:
            damped = normal + damping * np.diag(np.maximum(np.diag(normal), 1e-9))
            step = np.asarray(-np.linalg.solve(damped, gradient), dtype=float)
            tried = (_turn(step[:3] / reach) @ R, origin + step[3:6], tool + step[6:])
            new = _position_residuals(T, xyz_mm, *tried)
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
    """Position errors (n, 3) mm, measured less fitted, in the arm's base."""
    base = setup.T_world_base
    tool = T[:, :3, 3] + T[:, :3, :3] @ setup.T_flange_tool[:3, 3]
    return np.asarray((xyz_mm - base[:3, 3]) @ base[:3, :3] - tool)


def frame(R: Array, origin: Array) -> Array:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, origin
    return T


def _position_residuals(T: Array, xyz_mm: Array, R: Array, origin: Array, tool: Array) -> Array:
    values: Array = xyz_mm - ((T[:, :3, 3] + T[:, :3, :3] @ tool) @ R.T + origin)
    return values.ravel()


def _design(T: Array, R: Array, tool: Array, reach: float) -> Array:
    x, y, z = ((T[:, :3, 3] + T[:, :3, :3] @ tool) @ R.T).T
    none = np.zeros_like(x)
    turn = np.stack([none, -z, y, z, none, -x, -y, x, none], axis=1).reshape(-1, 3, 3) / reach
    place = np.tile(-np.eye(3), (len(T), 1, 1))
    slopes: Array = np.concatenate([turn, place, -R @ T[:, :3, :3]], axis=2)
    return slopes.reshape(-1, 9)


def _turn(vector: Array) -> Array:
    angle = float(np.linalg.norm(vector))
    x, y, z = vector / angle if angle > 0 else vector
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K)


_STEP = 1e-5
_ROUNDS = 30
REACH_MM = 500.0
"""Distance at which rotations are expressed as lengths, so that all unknowns are in mm."""
_LEAST_DAMPING_OF_ARM, _MOST_DAMPING_OF_ARM = 1e-10, 1e2
_ENOUGH = 1e-3
"""Share of the residual by which a further step must reduce it."""
DETERMINED = 1e-6
"""Share of the largest singular value above which a direction is determined."""
_FIELDS = (("a", 1.0), ("alpha", REACH_MM), ("beta", REACH_MM), ("d", 1.0), ("offset", REACH_MM))


@dataclass(frozen=True)
class FittedArm:
    """Arm with all constants fitted. left_mm (n,): residuals. design (n, unknowns): derivatives. spare: degrees of
    freedom."""

    arm: Arm
    left_mm: Array
    design: Array
    spare: int

    @property
    def rms_mm(self) -> float:
        """Root mean square distance of a position, corrected for the number of unknowns."""
        return float(np.sqrt(3 * (self.left_mm**2).sum() / max(self.spare, 1)))


def fit_arm(bare: Arm, q: Array, xyz_mm: Array) -> FittedArm:
    """Fit an arm, from its nominal constants, to target positions at joints q (n, axes) rad.

    T_world_base of the result contains the instrument frame, T_flange_tool the target.
    """
    start = fit_setup(forward(bare, q), xyz_mm)
    begin = replace(bare, T_world_base=start.T_world_base, T_flange_tool=start.T_flange_tool)

    def changed(change: Array) -> Arm:
        shift, turn, target = change[-9:-6], change[-6:-3] / REACH_MM, change[-3:]
        T_flange_tool = begin.T_flange_tool @ frame(np.eye(3), target)
        arm = _with_constants(begin, change[:-9])
        return replace(arm, T_world_base=moved_by(arm.T_world_base, shift, turn), T_flange_tool=T_flange_tool)

    return _fitted(changed, len(_FIELDS) * bare.axes + 9, lambda arm: (xyz_mm - forward(arm, q)[:, :3, 3]).ravel())


def fit_constants(arm: Arm, q: Array, xyz_mm: Array, R: Array | None) -> FittedArm:
    """Fit the arm constants to tool positions, and orientations R (n, 3, 3) if given; base and tool stay."""

    def misfit(candidate: Arm) -> Array:
        T = forward(candidate, q)
        parts = [(xyz_mm - T[:, :3, 3]).ravel()]
        return np.concatenate(parts if R is None else [*parts, REACH_MM * (R - T[:, :3, :3]).ravel() / np.sqrt(3)])

    return _fitted(lambda change: _with_constants(arm, change), len(_FIELDS) * arm.axes, misfit)


def undetermined_mm(fitted: FittedArm, q: Array) -> float:
    """Largest displacement at joints q (n, axes) rad by a change of 1 mm in constants that a fit left undetermined."""
    sizes, vt = np.linalg.svd(fitted.design, full_matrices=True)[1:]
    determined = np.zeros(len(vt), dtype=bool)
    determined[: len(sizes)] = sizes > DETERMINED * sizes[0]
    at = forward(fitted.arm, q)[:, :3, 3]
    moved = [forward(_with_constants(fitted.arm, change), q)[:, :3, 3] - at for change in vt[~determined]]
    return float(max((np.linalg.norm(way, axis=1).max() for way in moved), default=0.0))


def _with_constants(arm: Arm, change: Array) -> Arm:
    parts = change.reshape(len(_FIELDS), arm.axes)
    return replace(
        arm, **{name: getattr(arm, name) + part / reach for (name, reach), part in zip(_FIELDS, parts, strict=True)}
    )


def _fitted(changed: Callable[[Array], Arm], count: int, misfit: Callable[[Arm], Array]) -> FittedArm:
    change, damping = np.zeros(count), _LEAST_DAMPING_OF_ARM
    residual, J = misfit(changed(change)), np.empty((0, count))
    for _ in range(_ROUNDS):
        J = np.stack([(misfit(changed(change + step)) - residual) / _STEP for step in _STEP * np.eye(count)], axis=1)
        before, gained = float(residual @ residual), 0.0
        u, sizes, vt = np.linalg.svd(J, full_matrices=False)
        determined = sizes > DETERMINED * sizes[0]
        while damping <= _MOST_DAMPING_OF_ARM and gained <= 0:
            # Undetermined directions would amplify rounding, which depends on the order of the rows.
            gains = determined * sizes / (sizes**2 + damping * float(np.sum(sizes**2)) / count)
            tried = change - vt.T @ (gains * (u.T @ residual))
            new = misfit(changed(tried))
            gained = before - float(new @ new)
            damping *= 10 if gained <= 0 else 0.1
        if gained <= 0:
            break
        change, residual, damping = tried, new, max(damping, _LEAST_DAMPING_OF_ARM)
        if gained < _ENOUGH * before:
            break
    sizes = np.linalg.svd(J, compute_uv=False)
    return FittedArm(changed(change), residual, J, residual.size - int((sizes > DETERMINED * sizes[0]).sum()))

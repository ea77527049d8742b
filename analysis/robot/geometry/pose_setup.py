"""Least-squares fits to measured positions: tracker frame and target, ball and sockets, or all constants of an arm.

All fits consist of rigid motions between point sets and small changes of a frame.

The unknown constants are a, alpha, beta, d and zero of each axis, the instrument frame, and the target position;
undetermined combinations keep their nominal values or move least (Marquardt). Positions computed by a controller are
reproduced to the last digit, unlike measured ones.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.robot.kinematics.arm import Arm, Array, Integers, base_places, forward, link_frames, rotation


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
    problem = _SetUpProblem(T, xyz_mm)
    R, origin, tool = start[:3, :3], start[:3, 3], np.zeros(3)
    turned, residual = problem.residual(R, origin, tool)
    square = residual @ residual
    damping = 1e-6
    for _ in range(steps):
        design = problem.design(R, turned)
        normal, gradient = design.T @ design, design.T @ residual
        diagonal = np.maximum(normal.flat[::10], 1e-9)
        while damping < _MOST_DAMPING:
            damped = normal.copy()
            damped.flat[::10] += damping * diagonal
            step = np.asarray(-np.linalg.solve(damped, gradient), dtype=float)
            tried = (_turn(step[:3] / problem.reach) @ R, origin + step[3:6], tool + step[6:])
            new_turned, new = problem.residual(*tried)
            new_square = new @ new
            if new_square <= square:
                break
            damping *= 10
        else:
            break
        gained = square - new_square
        R, origin, tool = tried
        turned, residual, square = new_turned, new, new_square
        damping = max(damping / 10, _LEAST_DAMPING)
        if gained <= _CONVERGED * square:
            break
    by_axis = problem.design(R, turned).reshape(3, len(T), 9)
    return PoseSetUp(frame(R, origin), frame(np.eye(3), tool), by_axis.transpose(1, 0, 2).reshape(-1, 9))


class _SetUpProblem:
    """Residuals and derivatives of `fit_setup`. Rows are ordered by coordinate, then by pose: few operations on long
    rows take a third of the time of many small ones.
    """

    def __init__(self, T: Array, xyz_mm: Array) -> None:
        count = len(T)
        self.reach = float(np.linalg.norm(T[:, :3, 3], axis=1).max()) or 1.0
        self._flange, self._measured = T[:, :3, 3].T.copy(), xyz_mm.T.copy()
        self._turns = T[:, :3, :3].transpose(1, 0, 2).reshape(3, 3 * count)
        """Rows of the flange rotations: coordinate of the base, then pose and coordinate of the flange."""
        self._design = np.zeros((3, count, 9))
        for axis in range(3):
            self._design[axis, :, 3 + axis] = -1.0

    def residual(self, R: Array, origin: Array, tool: Array) -> tuple[Array, Array]:
        """Positions (3, n) in the base turned by R, and residuals (3 n,) of the measured positions."""
        local = self._flange + (self._turns.reshape(-1, 3) @ tool).reshape(self._flange.shape)
        turned = R @ local
        return turned, (self._measured - turned - origin[:, None]).ravel()

    def design(self, R: Array, turned: Array) -> Array:
        """Derivatives (3 n, 9) of the residuals by turn (times reach), base and tool. Valid until the next call."""
        design = self._design
        x, y, z = turned / self.reach
        design[0, :, 1], design[0, :, 2] = -z, y
        design[1, :, 0], design[1, :, 2] = z, -x
        design[2, :, 0], design[2, :, 1] = -y, x
        np.negative((R @ self._turns).reshape(design.shape[0], -1, 3), out=design[:, :, 6:])
        return design.reshape(-1, 9)


def position_error(T: Array, xyz_mm: Array, setup: PoseSetUp) -> Array:
    """Position errors (n, 3) mm, measured less fitted, in the arm's base."""
    base = setup.T_world_base
    tool = T[:, :3, 3] + T[:, :3, :3] @ setup.T_flange_tool[:3, 3]
    return np.asarray((xyz_mm - base[:3, 3]) @ base[:3, :3] - tool)


def frame(R: Array, origin: Array) -> Array:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, origin
    return T


def _turn(vector: Array) -> Array:
    """Rotation matrix (3, 3). For a single rotation it is five times as fast as `rotation`."""
    x, y, z = vector.tolist()
    angle = math.sqrt(x * x + y * y + z * z)
    if angle > 0:
        x, y, z = x / angle, y / angle, z / angle
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(_UNTURNED + math.sin(angle) * K + (1 - math.cos(angle)) * (K @ K))


_UNTURNED = np.eye(3)
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

    def design(change: Array) -> Array:
        arm = changed(change)
        by_constants, by_place = _place_slopes(arm, q)
        by_turn = by_place[:, :, 3:6] @ _left_jacobian(change[-6:-3] / REACH_MM) / REACH_MM
        slopes = np.concatenate([by_constants, by_place[:, :, :3], by_turn, by_place[:, :, 6:]], axis=2)
        return -slopes.reshape(3 * len(q), -1)

    count = len(_FIELDS) * bare.axes + 9
    return _fitted(changed, count, lambda arm: (xyz_mm - forward(arm, q)[:, :3, 3]).ravel(), design)


def _place_slopes(arm: Arm, q: Array) -> tuple[Array, Array]:
    """Derivatives of the tool positions at joints q (n, axes) rad: by the constants, (n, 3, 5 axes) in mm, and by base
    position, rotation of the base about its origin, and tool position, (n, 3, 9).
    """
    links, base = link_frames(arm, q), base_places(arm, q)
    at = in_each_frame(links[:, -1], arm.T_flange_tool[:3, 3])
    by_constants = np.empty((len(q), 3, len(_FIELDS), arm.axes))
    R, origin = np.broadcast_to(arm.T_world_base[:3, :3], (len(q), 3, 3)), base
    for axis, alpha in enumerate(arm.alpha.tolist()):
        along, across = R[:, :, 0], R[:, :, 1] * math.cos(alpha) + R[:, :, 2] * math.sin(alpha)
        after_a = origin + arm.a[axis] * along
        R, origin = links[:, axis, :3, :3], links[:, axis, :3, 3]
        for field, slope in enumerate((
            along,
            np.cross(along, at - after_a),
            np.cross(across, at - after_a),
            R[:, :, 2],
            np.cross(R[:, :, 2], at - origin),
        )):  # fmt: skip
            by_constants[:, :, field, axis] = slope / _FIELDS[field][1]
    by_place = np.empty((len(q), 3, 9))
    by_place[:, :, :3] = np.eye(3)
    by_place[:, :, 3:6] = np.cross(np.eye(3), (at - base)[:, None]).transpose(0, 2, 1)
    by_place[:, :, 6:] = R @ arm.T_flange_tool[:3, :3]
    return by_constants.reshape(len(q), 3, -1), by_place


def in_each_frame(T: Array, point: Array) -> Array:
    """Positions (n, 3) of one point (3,) in frames T (n, 4, 4)."""
    return np.asarray(T[:, :3, :3] @ point + T[:, :3, 3])


def _left_jacobian(turn: Array) -> Array:
    """Small rotation after `turn` (3,) rad per change of the rotation vector, to the second order of the angle."""
    K = np.cross(np.eye(3), turn).T
    return np.asarray(np.eye(3) + K / 2 + K @ K / 6)


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


def _fitted(
    changed: Callable[[Array], Arm],
    count: int,
    misfit: Callable[[Arm], Array],
    design: Callable[[Array], Array] | None = None,
) -> FittedArm:
    """Fit by Levenberg-Marquardt. design: derivatives of the misfit at a change, numerical ones if None."""
    change, damping = np.zeros(count), _LEAST_DAMPING_OF_ARM
    residual, J = misfit(changed(change)), np.empty((0, count))

    def by_differences(change: Array) -> Array:
        columns = [(misfit(changed(change + step)) - residual) / _STEP for step in _STEP * np.eye(count)]
        return np.stack(columns, axis=1)

    for _ in range(_ROUNDS):
        J = (design or by_differences)(change)
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

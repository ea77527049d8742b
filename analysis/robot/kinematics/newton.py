"""Damped Newton for inverse kinematics on stacks: from start angles to the nearest solution of each pose.

The method works for any arm. With more than six axes, each step is the shortest possible; with fewer, only poses that
the arm reaches exactly converge. Converged rows are removed from the stack, so that a few hard poses do not slow down
the others. The Jacobian also shows the distance to a singularity, and the axes involved.

With five axes a tool can reach any position, and two of the three rotations (`newton_in_part`). The position has
priority, and the orientation is as close as possible: steps of the orientation use only joint motions that preserve the
position (Y. Nakamura, H. Hanafusa, T. Yoshikawa, Task-Priority Based Redundancy Control of Robot Manipulators, 1987).
No weighting of mm against radians is required.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from analysis.robot.kinematics.arm import (
    Arm,
    Array,
    Mask,
    blocks,
    column_error,
    columns_of,
    forward,
    forward_and_jacobian,
    pose_error,
    tool_and_motions,
    tool_columns,
)

LENGTH_MM = 500.0
"""Length that relates rotations to translations: the size of an arm."""
TOLERANCE_MM = 1e-9
REACHED_MM = 1e3 * TOLERANCE_MM
"""Largest error after which a last step is sufficient. If the Jacobian is regular, the error is then much smaller."""
_LARGEST_STEP = 0.5
_FEW = 6
_BLOCK = 1000
"""Poses per block. Half as many take 20 % longer because of call overhead; many more exceed the processor's caches."""


def newton(arm: Arm, poses: Array, q: Array, iterations: int = 60) -> tuple[Array, Mask]:
    """Angles (n, 6) rad of poses (n, 4, 4) from start angles q (n, 6), and a mask (n,) of convergence.

    The limit is 1e-6 mm, with a radian counted as 500 mm; with a regular Jacobian the final error is below 1e-9 mm.
    """
    q, off_mm = _all_converged(arm, poses, q, iterations)
    return q, off_mm < REACHED_MM


def _all_converged(arm: Arm, poses: Array, q: Array, iterations: int) -> tuple[Array, Array]:
    q, off_mm, rows = q.copy(), np.full(len(q), np.inf), np.arange(len(q))
    # The rows that remain after a few steps are processed together, to reduce call overhead.
    for steps in (min(iterations, _FEW), iterations - _FEW):
        for block in blocks(len(rows) if steps > 0 else 0, _BLOCK):
            moving = rows[block]
            q[moving], off_mm[moving] = _converge(arm, poses[moving], q[moving], steps)
        rows = rows[off_mm[rows] >= TOLERANCE_MM]
    return q, off_mm


def _converge(arm: Arm, poses: Array, q: Array, iterations: int) -> tuple[Array, Array]:
    """Angles (n, 6) rad, and errors (n,) mm before the last step."""
    q = q.copy()
    size = np.full(len(q), np.inf)
    active = np.flatnonzero(np.isfinite(q).all(axis=1) & np.isfinite(poses).all(axis=(1, 2)))
    at, targets = q[active].T, columns_of(poses[active])
    for _ in range(iterations):
        tool, motions = tool_and_motions(arm, at.T)
        error = _error_mm(tool, targets)
        size[active] = _length(error)
        moving = size[active] >= TOLERANCE_MM
        if not moving.all():
            q[active] = at.T
            active, at, targets = active[moving], at[:, moving], targets[:, :, moving]
            motions, error = motions[:, :, moving], error[:, moving]
        if not len(active):
            break
        motions[:, 3:] *= LENGTH_MM
        if arm.axes > len(error):
            across = motions.transpose(1, 0, 2)
            step = _applied(motions, _solved(_damped(_normal(across), size[active]), error[:, None])[:, 0])
        else:
            normal, pull = _damped(_normal(motions), size[active]), _applied(motions, error)
            step = _solved(normal, pull[:, None])[:, 0]
        at = at.copy()
        at[: arm.axes] += _limited(step)  # the rail does not move
    q[active] = at.T
    return q, size


def from_nearby(arm: Arm, poses: Array, q: Array, within_mm: float = np.inf) -> tuple[Array, Array, Array]:
    """Angles (n, 6) rad, and errors (n,) mm before the last step."""
    at, off_mm, regularity, near = q.copy(), np.empty(len(q)), np.empty(len(q)), np.empty(len(q), dtype=bool)
    for block in blocks(len(q), _BLOCK):
        off_mm[block], regularity[block], near[block] = _simplified(arm, poses[block], at[block], within_mm)
    far_on = np.flatnonzero(near & ~(off_mm < TOLERANCE_MM))
    at[far_on], off_mm[far_on] = _all_converged(arm, poses[far_on], q[far_on], _FEW)
    return at, off_mm, regularity


def _simplified(arm: Arm, poses: Array, q: Array, within_mm: float) -> tuple[Array, Array, Mask]:
    """Update q, and return errors (n,) mm, initial regularity (n,), and a mask (n,) of the rows solved: those within
    within_mm.
    """
    tool, motions = tool_and_motions(arm, q)
    targets = columns_of(poses)
    error = _error_mm(tool, targets)
    near = np.maximum(_length(error[:3]), _length(error[3:])) < within_mm
    size, regularity, active = np.full(len(q), np.inf), np.zeros(len(q)), np.flatnonzero(near)
    if len(active) < len(q):
        motions, error, targets = motions[:, :, active], error[:, active], targets[:, :, active]
    motions[:, 3:] *= LENGTH_MM
    back = _solved(_damped(_normal(motions), np.zeros(len(active))), motions)
    regularity[active] = 1 / (_length(motions.reshape(36, -1)) * _length(back.reshape(36, -1)))
    at = q[active].T
    for _ in range(_FEW if len(active) else 0):
        at = at + _limited(_applied(back, error))
        error = _error_mm(tool_columns(arm, at.T), targets)
        size[active] = _length(error)
        off = size[active] >= TOLERANCE_MM
        if not off.all():
            q[active] = at.T
            active, at, targets = active[off], at[:, off], targets[:, :, off]
            error, back = error[:, off], back[:, :, off]
        if not len(active):
            break
    q[active] = at.T
    return size, regularity, near


def _error_mm(tool: Array, targets: Array) -> Array:
    """Error (6, n) mm of frames given as columns (4, 3, n), with a radian counted as 500 mm."""
    error = column_error(tool, targets)
    error[3:] *= LENGTH_MM
    return error


def _length(vectors: Array) -> Array:
    return np.asarray(np.sqrt(np.einsum("kn,kn->n", vectors, vectors)))


def _normal(motions: Array) -> Array:
    normal = np.empty((len(motions), len(motions), motions.shape[2]))
    for row, motion in zip(normal, motions, strict=True):
        row[:] = _applied(motions, motion)
    return normal


def _applied(matrices: Array, vectors: Array) -> Array:
    return np.asarray(np.einsum("ijn,jn->in", matrices, vectors))


def _damped(normal: Array, size: Array) -> Array:
    """Add damping to normal equations (6, 6, n) in place, for errors of size (n,) mm.

    The damping decreases with the error: the steps are safe for large errors, and converge quadratically for small
    ones. A minimum above the rounding error of the normal equations ensures that a singular pose has a step.
    """
    diagonal = np.einsum("iin->in", normal)
    diagonal += 1e-6 * size**2 + 1e-14 * diagonal.sum(axis=0)
    return normal


def _solved(normal: Array, right: Array) -> Array:
    """Solve normal equations (k, k, n), k up to 6, for right sides (k, m, n).

    Elimination with samples last takes a tenth of numpy's time; a positive definite matrix requires no pivoting.
    """
    both, size = np.concatenate([normal, right], axis=1), len(normal)
    for row in range(size):
        both[row, row + 1 :] /= both[row, row]
        both[row + 1 :, row + 1 :] -= both[row + 1 :, row, None] * both[row, None, row + 1 :]
    solution = both[:, size:]
    for row in range(size - 2, -1, -1):
        solution[row] -= (both[row, row + 1 : size, None] * solution[row + 1 :]).sum(axis=0)
    return solution


def _limited(step: Array) -> Array:
    limited: Array = step * np.minimum(1.0, _LARGEST_STEP / np.maximum(np.abs(step).max(axis=0), 1e-300))
    return limited


_TAKES_PART = 0.1
"""Smallest component of the unit joint motion that preserves the tool for which an axis is part of a singularity."""


def conditioning(arm: Arm, q: Array) -> Array:
    """Ratio (n,) of smallest to largest singular value of the Jacobian, 0 at a singularity and 1 for an isotropic arm.

    A radian of tool rotation counts as 500 mm. The joints are those of the controller.
    """
    return null_motion(arm, q)[0]


def null_motion(arm: Arm, q: Array) -> tuple[Array, Array]:
    """Conditioning (n,), and the unit joint motion (n, 6) that moves the tool least."""
    J = forward_and_jacobian(arm, q)[1]
    J[:, 3:] *= LENGTH_MM
    _, values, motions = np.linalg.svd(J)
    return values[:, -1] / values[:, 0], motions[:, -1]


def cancelling_axes(arm: Arm, q: Array) -> list[int]:
    """Axes involved in the joint motion that moves the tool least: 4 and 6 at a wrist singularity, 2, 3 and 5 of a
    stretched elbow.
    """
    _, still = null_motion(arm, q[None])
    return [int(axis) + 1 for axis in np.flatnonzero(np.abs(still[0]) > _TAKES_PART)]


_STILL_RAD = 1e-10
"""Largest step in rad after which the orientation is the closest possible."""
_LARGEST_STEP_IN_PART = 0.3
_STEPS_IN_PART = 60
_SINGULAR = 1e-6
"""Singular values below this fraction of the largest count as zero: the tool cannot move in that direction."""

Poses = Callable[[Array], Array]
"""Function that returns tool poses (n, 4, 4) for joint angles (n, axes) rad."""


def newton_in_part(arm: Arm, targets: Array, q: Array, tool: Poses | None = None) -> tuple[Array, Mask]:
    """Angles (n, axes) rad for `targets` (n, 4, 4), and a mask (n,) of the positions reached, with the orientation as
    close as possible.

    tool: true tool poses of an arm close to the nominal one, whose Jacobian is used.
    """
    at, reached = q.copy(), np.zeros(len(q), dtype=bool)
    moving = np.flatnonzero(np.isfinite(q).all(axis=1) & np.isfinite(targets).all(axis=(1, 2)))
    for _ in range(_STEPS_IN_PART):
        if not len(moving):
            break
        error = pose_error((tool or (lambda angles: forward(arm, angles)))(at[moving]), targets[moving])
        J_place, J_turn = np.split(forward_and_jacobian(arm, at[moving])[1][:, :, : arm.axes], 2, axis=1)
        # Solve the position first, then the orientation by motions that preserve the position.
        to_place = np.linalg.pinv(J_place, rcond=_SINGULAR)
        step = np.einsum("nij,nj->ni", to_place, error[:, :3])
        free = np.eye(arm.axes) - to_place @ J_place
        turn = error[:, 3:] - np.einsum("nij,nj->ni", J_turn, step)
        step += np.einsum("nij,nj->ni", np.linalg.pinv(J_turn @ free, rcond=_SINGULAR), turn)
        arrived = np.linalg.norm(error[:, :3], axis=1) < REACHED_MM
        still = np.abs(step).max(axis=1) < _STILL_RAD
        reached[moving[arrived & still]] = True
        moving, step = moving[~(arrived & still)], step[~(arrived & still)]
        at[moving, : arm.axes] += np.clip(step, -_LARGEST_STEP_IN_PART, _LARGEST_STEP_IN_PART)
    return at, reached


def turned_rad(tool: Array, targets: Array) -> Array:
    turned: Array = np.linalg.norm(pose_error(tool, targets)[:, 3:], axis=1)
    return turned

"""Damped Newton for inverse kinematics on stacks: from start angles to the nearest solution of each pose.

Works for any arm; with more than six axes, each step is the shortest possible. Converged rows leave the stack, so that
a few hard poses do not slow down the rest. The Jacobian also shows the distance to a singularity and the axes involved.

With five axes a tool reaches any position and two rotations (`newton_in_part`). The position has priority, and the
orientation is the closest one possible there: rotational steps use only motions that preserve the position (Y.
Nakamura,
H. Hanafusa, T. Yoshikawa, Task-Priority Based Redundancy Control of Robot Manipulators, 1987). No weighting of mm
against
radians is involved.
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
"""Weight of rotations relative to translations: the size of an arm."""
TOLERANCE_MM = 1e-9
REACHED_MM = 1e3 * TOLERANCE_MM
"""Convergence limit; after the subsequent step the error is far smaller if the Jacobian is regular."""
_LARGEST_STEP = 0.5
_FEW = 6
_BLOCK = 1000
"""Poses per block: half as many take a fifth longer because of call overhead; many more exceed the processor's
caches."""


def newton(arm: Arm, poses: Array, q: Array, iterations: int = 60) -> tuple[Array, Mask]:
    """Solve poses (n, 4, 4) from angles q (n, 6) rad: angles (n, 6) rad, and a mask (n,) of convergence.

    Converged means within 1e-6 mm, a radian counted as 500 mm; with a regular Jacobian the steps continue to 1e-9 mm.
    """
    q, off_mm = _all_converged(arm, poses, q, iterations)
    return q, off_mm < REACHED_MM


def _all_converged(arm: Arm, poses: Array, q: Array, iterations: int) -> tuple[Array, Array]:
    """Converge block by block."""
    q, off_mm, rows = q.copy(), np.full(len(q), np.inf), np.arange(len(q))
    # Rows left after a few steps are processed together, to reduce call overhead.
    for steps in (min(iterations, _FEW), iterations - _FEW):
        for block in blocks(len(rows) if steps > 0 else 0, _BLOCK):
            moving = rows[block]
            q[moving], off_mm[moving] = _converge(arm, poses[moving], q[moving], steps)
        rows = rows[off_mm[rows] >= TOLERANCE_MM]
    return q, off_mm


def _converge(arm: Arm, poses: Array, q: Array, iterations: int) -> tuple[Array, Array]:
    """Converge from angles q (n, 6) rad to poses (n, 4, 4): angles (n, 6) rad, and the error (n,) mm before the last
    step."""
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
        at[: arm.axes] += _limited(step)  # the rail stays in place
    q[active] = at.T
    return q, size


def from_nearby(arm: Arm, poses: Array, q: Array, within_mm: float = np.inf) -> tuple[Array, Array, Array]:
    """Solve each pose (n, 4, 4) from nearby angles q (n, 6) rad, in half the time of `newton`.

    Returns angles (n, 6) rad, the final errors (n,) mm, and the initial regularity (n,). Simplified Newton: the initial
    Jacobian serves all steps, followed by a few full Newton steps if necessary. Regularity is a lower bound of the
    conditioning, at most ten times too low. Rows starting further off than within_mm are not solved, with infinite
    error.
    """
    at, off_mm, regularity, near = q.copy(), np.empty(len(q)), np.empty(len(q)), np.empty(len(q), dtype=bool)
    for block in blocks(len(q), _BLOCK):
        off_mm[block], regularity[block], near[block] = _simplified(arm, poses[block], at[block], within_mm)
    far_on = np.flatnonzero(near & ~(off_mm < TOLERANCE_MM))
    at[far_on], off_mm[far_on] = _all_converged(arm, poses[far_on], q[far_on], _FEW)
    return at, off_mm, regularity


def _simplified(arm: Arm, poses: Array, q: Array, within_mm: float) -> tuple[Array, Array, Mask]:
    """Update q (n, 6) rad; return errors (n,) mm, initial regularity (n,), and a mask (n,) of rows that started
    within within_mm."""
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
    """Return the error (6, n) of frames given as columns (4, 3, n), a radian counted as 500 mm."""
    error = column_error(tool, targets)
    error[3:] *= LENGTH_MM
    return error


def _length(vectors: Array) -> Array:
    """Return the lengths (n,) of vectors (k, n)."""
    return np.asarray(np.sqrt(np.einsum("kn,kn->n", vectors, vectors)))


def _normal(motions: Array) -> Array:
    """Return the normal equations (6, 6, n) of joint motions (6, 6, n)."""
    normal = np.empty((len(motions), len(motions), motions.shape[2]))
    for row, motion in zip(normal, motions, strict=True):
        row[:] = _applied(motions, motion)
    return normal


def _applied(matrices: Array, vectors: Array) -> Array:
    """Return the products (6, n) of matrices (6, 6, n) and vectors (6, n)."""
    return np.asarray(np.einsum("ijn,jn->in", matrices, vectors))


def _damped(normal: Array, size: Array) -> Array:
    """Add damping to normal equations (6, 6, n) in place, for errors of size (n,) mm.

    The damping decreases with the error: safe far away, quadratic close by. The minimum exceeds the rounding of the
    normal equations; otherwise a singular pose would have no step.
    """
    diagonal = np.einsum("iin->in", normal)
    diagonal += 1e-6 * size**2 + 1e-14 * diagonal.sum(axis=0)
    return normal


def _solved(normal: Array, right: Array) -> Array:
    """Solve normal equations (6, 6, n) for right sides (6, k, n).

    Elimination with samples last takes a tenth of numpy's time; a positive definite matrix needs no pivots.
    """
    both = np.concatenate([normal, right], axis=1)
    for row in range(6):
        both[row, row + 1 :] /= both[row, row]
        both[row + 1 :, row + 1 :] -= both[row + 1 :, row, None] * both[row, None, row + 1 :]
    solution = both[:, 6:]
    for row in range(4, -1, -1):
        solution[row] -= (both[row, row + 1 : 6, None] * solution[row + 1 :]).sum(axis=0)
    return solution


def _limited(step: Array) -> Array:
    """Return steps (6, n) rad, shortened to at most half a radian per axis."""
    limited: Array = step * np.minimum(1.0, _LARGEST_STEP / np.maximum(np.abs(step).max(axis=0), 1e-300))
    return limited


_TAKES_PART = 0.1
"""Minimum share of an axis in the unit joint motion that preserves the tool, to count as part of a singularity."""


def conditioning(arm: Arm, q: Array) -> Array:
    """Return the ratio (n,) of smallest to largest singular value of the Jacobian at q (n, 6) rad: 0 singular, 1
    isotropic.

    A radian of tool rotation counts as 500 mm; the joints are those of the controller.
    """
    return null_motion(arm, q)[0]


def null_motion(arm: Arm, q: Array) -> tuple[Array, Array]:
    """Return the conditioning (n,) at q (n, 6) rad, and the unit joint motion (n, 6) with the smallest tool motion."""
    J = forward_and_jacobian(arm, q)[1]
    J[:, 3:] *= LENGTH_MM
    _, values, motions = np.linalg.svd(J)
    return values[:, -1] / values[:, 0], motions[:, -1]


def cancelling_axes(arm: Arm, q: Array) -> list[int]:
    """Return the axes (1 … 6) involved in the joint motion with the smallest tool motion at q (6,) rad.

    4 and 6 is the wrist singularity; 2, 3 and 5 a stretched elbow arm.
    """
    _, still = null_motion(arm, q[None])
    return [int(axis) + 1 for axis in np.flatnonzero(np.abs(still[0]) > _TAKES_PART)]


_STILL_RAD = 1e-10
"""Steps below which the orientation is the closest possible."""
_LARGEST_STEP_IN_PART = 0.3
_STEPS_IN_PART = 60
_SINGULAR = 1e-6
"""Singular values below this share of the largest count as zero: the tool cannot move in that direction."""

Poses = Callable[[Array], Array]
"""Tool poses (n, 4, 4) at joint angles (n, axes) rad."""


def newton_in_part(arm: Arm, targets: Array, q: Array, tool: Poses | None = None) -> tuple[Array, Mask]:
    """Solve `targets` (n, 4, 4) from angles q (n, axes) rad, position first.

    Returns angles (n, axes) rad, and a mask (n,) of reached positions, with the orientation as close as possible. tool:
    true tool poses of an arm close to the nominal one, whose Jacobian is used.
    """
    at, reached = q.copy(), np.zeros(len(q), dtype=bool)
    moving = np.flatnonzero(np.isfinite(q).all(axis=1) & np.isfinite(targets).all(axis=(1, 2)))
    for _ in range(_STEPS_IN_PART):
        if not len(moving):
            break
        error = pose_error((tool or (lambda angles: forward(arm, angles)))(at[moving]), targets[moving])
        J_place, J_turn = np.split(forward_and_jacobian(arm, at[moving])[1][:, :, : arm.axes], 2, axis=1)
        # First the position, then the orientation by motions that preserve the position.
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
    """Return the rotation angles (n,) rad between tools (n, 4, 4) and targets."""
    turned: Array = np.linalg.norm(pose_error(tool, targets)[:, 3:], axis=1)
    return turned

"""Damped Newton for inverse kinematics on stacks: from starting angles to the nearest solution of each pose.

Works for any arm; where it has more than six axes, each step is the shortest of those that lead there. Rows that have
converged leave the stack, so that a few hard poses do not make all of them pay.

How near the arm is to a singularity, and which axes make it, shows in the same Jacobian.

With five axes a tool takes a place in all three coordinates and turns in two ways (`newton_in_part`). So the place
comes first, and the turn is the nearest of those with which the tool is there: the steps for the turn are taken among
the motions that leave the place alone (Y. Nakamura, H. Hanafusa, T. Yoshikawa, Task-Priority Based Redundancy Control
of Robot Manipulators, 1987). No weight of millimetres against radians decides.
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
"""Weighs rotations against translations: the size of an arm."""
TOLERANCE_MM = 1e-9
REACHED_MM = 1e3 * TOLERANCE_MM
"""What counts as there: with the step that still follows it is far closer where the Jacobian is regular."""
_LARGEST_STEP = 0.5
_FEW = 6
_BLOCK = 1000
"""Poses at a time: half as many take a fifth longer, for the calls of numpy; many more do not stay in the processor's
caches."""


def newton(arm: Arm, poses: Array, q: Array, iterations: int = 60) -> tuple[Array, Mask]:
    """From angles q (n, 6) rad towards poses (n, 4, 4): angles (n, 6) rad, and which (n,) of them converged.

    Converged is within 1e-6 mm, a radian counted as 500 mm; where the Jacobian is regular the steps go on
    to 1e-9 mm.
    """
    q, off_mm = _all_converged(arm, poses, q, iterations)
    return q, off_mm < REACHED_MM


def _all_converged(arm: Arm, poses: Array, q: Array, iterations: int) -> tuple[Array, Array]:
    """Like `_converge`, block by block."""
    q, off_mm, rows = q.copy(), np.full(len(q), np.inf), np.arange(len(q))
    # What a few steps do not bring there goes on together: few poses at a time would pay for the calls alone.
    for steps in (min(iterations, _FEW), iterations - _FEW):
        for block in blocks(len(rows) if steps > 0 else 0, _BLOCK):
            moving = rows[block]
            q[moving], off_mm[moving] = _converge(arm, poses[moving], q[moving], steps)
        rows = rows[off_mm[rows] >= TOLERANCE_MM]
    return q, off_mm


def _converge(arm: Arm, poses: Array, q: Array, iterations: int) -> tuple[Array, Array]:
    """From angles q (n, 6) towards poses (n, 4, 4): angles (n, 6), and how many mm (n,) they were off before the last
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
        at[: arm.axes] += _limited(step)  # a rail stays where it stands
    q[active] = at.T
    return q, size


def from_nearby(arm: Arm, poses: Array, q: Array, within_mm: float = np.inf) -> tuple[Array, Array, Array]:
    """From angles q (n, 6) rad already near a solution of each pose (n, 4, 4), in half the time of `newton`: angles
    (n, 6) rad, how many mm (n,) they were off at last, and the regularity (n,) where they began.

    The simplified method: the Jacobian of the start serves for all steps; where this takes too many, a few steps of
    Newton's own. Regularity is a lower bound of the conditioning, at most ten times too low. What begins further off
    than within_mm stays there, infinitely far off.
    """
    at, off_mm, regularity, near = q.copy(), np.empty(len(q)), np.empty(len(q)), np.empty(len(q), dtype=bool)
    for block in blocks(len(q), _BLOCK):
        off_mm[block], regularity[block], near[block] = _simplified(arm, poses[block], at[block], within_mm)
    far_on = np.flatnonzero(near & ~(off_mm < TOLERANCE_MM))
    at[far_on], off_mm[far_on] = _all_converged(arm, poses[far_on], q[far_on], _FEW)
    return at, off_mm, regularity


def _simplified(arm: Arm, poses: Array, q: Array, within_mm: float) -> tuple[Array, Array, Mask]:
    """Moves q (n, 6) and returns how many mm (n,) it is off then, the regularity (n,) where it began, and which (n,)
    began within so many mm."""
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
    """The error (6, n) of frames by their columns (4, 3, n), a radian counted as 500 mm."""
    error = column_error(tool, targets)
    error[3:] *= LENGTH_MM
    return error


def _length(vectors: Array) -> Array:
    """Lengths (n,) of vectors (k, n)."""
    return np.asarray(np.sqrt(np.einsum("kn,kn->n", vectors, vectors)))


def _normal(motions: Array) -> Array:
    """Normal equations (6, 6, n) of motions by joint (6, 6, n)."""
    normal = np.empty((len(motions), len(motions), motions.shape[2]))
    for row, motion in zip(normal, motions, strict=True):
        row[:] = _applied(motions, motion)
    return normal


def _applied(matrices: Array, vectors: Array) -> Array:
    """Products (6, n) of matrices (6, 6, n) and vectors (6, n)."""
    return np.asarray(np.einsum("ijn,jn->in", matrices, vectors))


def _damped(normal: Array, size: Array) -> Array:
    """Normal equations (6, 6, n) with damping for errors of so many mm (n,), in place.

    Damping that fades with the error: safe far away, quadratic close by. What stays is above the rounding of the normal
    equations, or a singular pose would have no step.
    """
    diagonal = np.einsum("iin->in", normal)
    diagonal += 1e-6 * size**2 + 1e-14 * diagonal.sum(axis=0)
    return normal


def _solved(normal: Array, right: Array) -> Array:
    """The solutions (6, k, n) of normal equations (6, 6, n) for right sides (6, k, n).

    By elimination with samples last, a tenth of the time of numpy's one by one; a positive definite matrix needs no
    pivots.
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
    """Steps (6, n) rad, shortened where an axis would go beyond half a radian."""
    limited: Array = step * np.minimum(1.0, _LARGEST_STEP / np.maximum(np.abs(step).max(axis=0), 1e-300))
    return limited


_TAKES_PART = 0.1
"""An axis takes part in a singularity with at least this share of a unit joint motion that leaves the tool still."""


def conditioning(arm: Arm, q: Array) -> Array:
    """Smallest over largest singular value (n,) of the Jacobian at q (n, 6) rad: 0 is a singularity, 1 isotropic.

    A radian of tool rotation counts as 500 mm; the joints are those of the controller.
    """
    return null_motion(arm, q)[0]


def null_motion(arm: Arm, q: Array) -> tuple[Array, Array]:
    """The conditioning (n,) at q (n, 6) rad, and the unit joint motion (n, 6) that moves the tool least."""
    J = forward_and_jacobian(arm, q)[1]
    J[:, 3:] *= LENGTH_MM
    _, values, motions = np.linalg.svd(J)
    return values[:, -1] / values[:, 0], motions[:, -1]


def cancelling_axes(arm: Arm, q: Array) -> list[int]:
    """The axes (1 … 6) whose motions come nearest to leaving the tool still, at q (6,) rad.

    4 and 6 is the wrist singularity, 2, 3 and 5 a stretched elbow arm.
    """
    _, still = null_motion(arm, q[None])
    return [int(axis) + 1 for axis in np.flatnonzero(np.abs(still[0]) > _TAKES_PART)]


_STILL_RAD = 1e-10
"""Steps below which the turn is the nearest."""
_LARGEST_STEP_IN_PART = 0.3
_STEPS_IN_PART = 60
_SINGULAR = 1e-6
"""Singular values below this share of the largest are none: the tool does not move that way."""

Poses = Callable[[Array], Array]
"""The tool (n, 4, 4) at joint angles (n, axes) rad."""


def newton_in_part(arm: Arm, targets: Array, q: Array, tool: Poses | None = None) -> tuple[Array, Mask]:
    """From angles q (n, axes) rad towards poses `targets` (n, 4, 4): angles (n, axes) rad, and for which (n,) the tool
    is at the place, turned as nearly as the arm can.

    tool: where it really is, of an arm near the nominal one, whose Jacobian serves.
    """
    at, reached = q.copy(), np.zeros(len(q), dtype=bool)
    moving = np.flatnonzero(np.isfinite(q).all(axis=1) & np.isfinite(targets).all(axis=(1, 2)))
    for _ in range(_STEPS_IN_PART):
        if not len(moving):
            break
        error = pose_error((tool or (lambda angles: forward(arm, angles)))(at[moving]), targets[moving])
        J_place, J_turn = np.split(forward_and_jacobian(arm, at[moving])[1][:, :, : arm.axes], 2, axis=1)
        # First the place, then the turn among what leaves the place alone.
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
    """How far (n,) rad tools (n, 4, 4) are turned from their targets."""
    turned: Array = np.linalg.norm(pose_error(tool, targets)[:, 3:], axis=1)
    return turned

"""Damped Newton for inverse kinematics on stacks: from starting angles to the nearest solution of each pose.

Works for any six-axis arm. Rows that have converged leave the stack, so that a few hard poses do not make
all of them pay.
"""

from __future__ import annotations

import numpy as np

from analysis.kinematics.arm import Arm, Array, Mask, blocks, forward, forward_and_jacobian, pose_error

LENGTH_MM = 500.0
"""Weighs rotations against translations: the size of an arm."""
_SCALE = np.array([1.0, 1.0, 1.0, LENGTH_MM, LENGTH_MM, LENGTH_MM])
TOLERANCE_MM = 1e-9
REACHED_MM = 1e3 * TOLERANCE_MM
"""What counts as there: with the step that still follows it is far closer where the Jacobian is regular."""
_LARGEST_STEP = 0.5
_FEW = 6
_BLOCK = 500
"""Poses at a time: their Jacobians and normal equations then stay in the processor's own cache, 0.6 of 1 MB."""


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
            some = rows[block]
            q[some], off_mm[some] = _converge(arm, poses[some], q[some], steps)
        rows = rows[off_mm[rows] >= TOLERANCE_MM]
    return q, off_mm


def _converge(arm: Arm, poses: Array, q: Array, iterations: int) -> tuple[Array, Array]:
    """From angles q (n, 6) towards poses (n, 4, 4): angles (n, 6), and how many mm (n,) they were off before the last
    step."""
    q = q.copy()
    size = np.full(len(q), np.inf)
    active = np.flatnonzero(np.isfinite(q).all(axis=1) & np.isfinite(poses).all(axis=(1, 2)))
    at, targets = q[active], poses[active]
    for _ in range(iterations):
        T, J = forward_and_jacobian(arm, at)
        error = pose_error(T, targets) * _SCALE
        size[active] = np.linalg.norm(error, axis=1)
        moving = size[active] >= TOLERANCE_MM
        if not moving.all():
            q[active] = at
            active, at, targets = active[moving], at[moving], targets[moving]
            J, error = J[moving], error[moving]
        if not len(active):
            break
        at = at + _step(J, error, size[active])
    q[active] = at
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
    rest = np.flatnonzero(near & ~(off_mm < TOLERANCE_MM))
    at[rest], off_mm[rest] = _all_converged(arm, poses[rest], q[rest], _FEW)
    return at, off_mm, regularity


def _simplified(arm: Arm, poses: Array, q: Array, within_mm: float) -> tuple[Array, Array, Mask]:
    """Moves q (n, 6) and returns how many mm (n,) it is off then, the regularity (n,) where it began, and which (n,)
    began within so many mm."""
    T, J = forward_and_jacobian(arm, q)
    error = pose_error(T, poses) * _SCALE
    near = np.maximum(np.linalg.norm(error[:, :3], axis=1), np.linalg.norm(error[:, 3:], axis=1)) < within_mm
    size, regularity, left = np.full(len(q), np.inf), np.zeros(len(q)), np.flatnonzero(near)
    if len(left) < len(q):
        J, error = J[left], error[left]
    J *= _SCALE[:, None]
    Jt = np.swapaxes(J, 1, 2)
    back = np.linalg.inv(_damped(Jt @ J, np.zeros(len(left))))
    regularity[left] = 1 / np.sqrt(np.einsum("nij,nij->n", J, J) * np.sqrt(np.einsum("nij,nij->n", back, back)))
    back = back @ Jt
    for _ in range(_FEW if len(left) else 0):
        q[left] += _limited((back @ error[:, :, None])[:, :, 0])
        error = pose_error(forward(arm, q[left]), poses[left]) * _SCALE
        size[left] = np.linalg.norm(error, axis=1)
        off = size[left] >= TOLERANCE_MM
        if not off.any():
            break
        left, error, back = left[off], error[off], back[off]
    return size, regularity, near


def _step(J: Array, error: Array, size: Array) -> Array:
    """The next step (n, 6) rad, no axis beyond half a radian, for errors (n, 6) of so many mm (n,)."""
    J = J * _SCALE[:, None]
    Jt = np.swapaxes(J, 1, 2)
    solved = np.linalg.solve(_damped(Jt @ J, size), Jt @ error[:, :, None])
    return _limited(np.asarray(solved[:, :, 0], dtype=np.float64))


def _damped(normal: Array, size: Array) -> Array:
    """Normal equations (n, 6, 6) with damping for errors of so many mm (n,), in place.

    Damping that fades with the error: safe far away, quadratic close by. What stays is above the rounding of the normal
    equations, or a singular pose would have no step.
    """
    diagonal = np.einsum("nii->ni", normal)
    diagonal += (1e-6 * size**2 + 1e-14 * diagonal.sum(axis=1))[:, None]
    return normal


def _limited(step: Array) -> Array:
    """Steps (n, 6) rad, shortened where an axis would go beyond half a radian."""
    largest = np.abs(step).max(axis=1, keepdims=True)
    limited: Array = step * np.minimum(1.0, _LARGEST_STEP / np.maximum(largest, 1e-300))
    return limited

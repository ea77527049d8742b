"""Damped Newton for inverse kinematics on stacks: from starting angles to the nearest solution of each pose.

Works for any six-axis arm. Rows that have converged leave the stack, so that a few hard poses do not make
all of them pay.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.kinematics.arm import Arm, Array, forward_and_jacobian, pose_error

LENGTH_MM = 500.0
"""Weighs rotations against translations: the size of an arm."""
_TOLERANCE_MM = 1e-9
_LARGEST_STEP = 0.5


def newton(arm: Arm, poses: Array, q: Array, iterations: int = 60) -> tuple[Array, NDArray[np.bool_]]:
    """From angles q (n, 6) rad towards poses (n, 4, 4): angles (n, 6) rad, and which (n,) of them converged.

    Converged is within 1e-6 mm, a radian counted as 500 mm; where the Jacobian is regular the steps go on
    to 1e-9 mm.
    """
    q = q.copy()
    size = np.full(len(q), np.inf)
    active = np.flatnonzero(np.isfinite(q).all(axis=1) & np.isfinite(poses).all(axis=(1, 2)))
    for _ in range(iterations):
        step, size[active] = _step(arm, poses[active], q[active])
        moving = size[active] >= _TOLERANCE_MM
        active = active[moving]
        if not len(active):
            break
        q[active] += step[moving]
    return q, size < 1e3 * _TOLERANCE_MM


def _step(arm: Arm, poses: Array, q: Array) -> tuple[Array, Array]:
    """The next step (n, 6) rad, no axis beyond half a radian, and the size (n,) mm of the error before it."""
    scale = np.array([1.0, 1.0, 1.0, LENGTH_MM, LENGTH_MM, LENGTH_MM])
    T, J = forward_and_jacobian(arm, q)
    error = pose_error(T, poses) * scale
    size: Array = np.linalg.norm(error, axis=1)
    J = J * scale[:, None]
    Jt = np.swapaxes(J, 1, 2)
    normal = Jt @ J
    # Damping that fades with the error: safe far away, quadratic close by. What stays is above the rounding
    # of the normal equations, or a singular pose would have no step.
    damping = 1e-6 * size**2 + 1e-14 * np.trace(normal, axis1=1, axis2=2)
    step = np.linalg.solve(normal + damping[:, None, None] * np.eye(6), Jt @ error[:, :, None])[:, :, 0]
    largest = np.abs(step).max(axis=1, keepdims=True)
    return step * np.minimum(1.0, _LARGEST_STEP / np.maximum(largest, 1e-300)), size

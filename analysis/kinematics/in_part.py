"""Inverse kinematics of an arm of fewer than six axes: its tool takes a place, and what turn it can have there.

With five axes a tool takes a place in all three coordinates and turns in two ways. So the place comes first, and the
turn is the nearest of those with which the tool is there: the steps for the turn are taken among the motions that leave
the place alone (Y. Nakamura, H. Hanafusa, T. Yoshikawa, Task-Priority Based Redundancy Control of Robot Manipulators,
1987). No weight of millimetres against radians decides.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from analysis.kinematics.arm import Arm, Array, Mask, forward, forward_and_jacobian, pose_error

REACHED_MM = 1e-6
"""A place is taken within a nanometre, as of an arm of six axes."""
_STILL_RAD = 1e-10
"""Steps below which the turn is the nearest."""
_LARGEST_STEP = 0.3
_STEPS = 60
_SINGULAR = 1e-6
"""Singular values below this share of the largest are none: the tool does not move that way."""

Poses = Callable[[Array], Array]
"""The tool (n, 4, 4) at joint angles (n, axes) rad."""


def nearest(arm: Arm, targets: Array, q: Array, tool: Poses | None = None) -> tuple[Array, Mask]:
    """From angles q (n, axes) rad towards poses `targets` (n, 4, 4): angles (n, axes) rad, and for which (n,) the tool
    is at the place, turned as nearly as the arm can.

    tool: where it really is, of an arm near the nominal one, whose Jacobian serves.
    """
    at, reached = q.copy(), np.zeros(len(q), dtype=bool)
    moving = np.flatnonzero(np.isfinite(q).all(axis=1) & np.isfinite(targets).all(axis=(1, 2)))
    for _ in range(_STEPS):
        if not len(moving):
            break
        error = pose_error((tool or (lambda angles: forward(arm, angles)))(at[moving]), targets[moving])
        step = _step(forward_and_jacobian(arm, at[moving])[1][:, :, : arm.axes], error)
        arrived = np.linalg.norm(error[:, :3], axis=1) < REACHED_MM
        still = np.abs(step).max(axis=1) < _STILL_RAD
        reached[moving[arrived & still]] = True
        moving, step = moving[~(arrived & still)], step[~(arrived & still)]
        at[moving, : arm.axes] += np.clip(step, -_LARGEST_STEP, _LARGEST_STEP)
    return at, reached


def turned_rad(tool: Array, targets: Array) -> Array:
    """How far (n,) rad tools (n, 4, 4) are turned from their targets."""
    turned: Array = np.linalg.norm(pose_error(tool, targets)[:, 3:], axis=1)
    return turned


def _step(jacobian: Array, error: Array) -> Array:
    """Steps (n, axes) rad for errors (n, 6): first the place, then the turn among what leaves the place alone."""
    J_place, J_turn = jacobian[:, :3], jacobian[:, 3:]
    to_place = np.linalg.pinv(J_place, rcond=_SINGULAR)
    step = np.einsum("nij,nj->ni", to_place, error[:, :3])
    free = np.eye(jacobian.shape[2]) - to_place @ J_place
    turn = error[:, 3:] - np.einsum("nij,nj->ni", J_turn, step)
    step += np.einsum("nij,nj->ni", np.linalg.pinv(J_turn @ free, rcond=_SINGULAR), turn)
    return np.asarray(step)

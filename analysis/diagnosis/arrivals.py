"""Joints of poses that were read before they stood: an error that goes with the way each joint came.

A link that goes on after its joint was read is ahead of what was reported, and a play holds it back: the sign tells one
from the other. Reversal errors of a healthy arm are of the same shape and could take it up with a wrong sign, so their
share is counted in. Where a joint comes from goes with where it is, so what goes with each joint's angle is taken off.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from analysis.diagnosis.blocks import Block
from analysis.diagnosis.linear import Linear, basis_of
from analysis.diagnosis.look import Look
from analysis.diagnosis.worth import LEAST_UM, plain_worth
from analysis.kinematics.arm import Array
from analysis.traces.tables import PoseTable

_SURE = 5.0
"""Standard deviations of a joint's error from which on it is told: of six joints, chance does so once in a million."""
_LEAST_SHARE = 0.2
"""Of the energy that is left, which must go with the way joints came. Poses are visited in some order, so a little of
what no effect explains always does: 8 % in a UR10 measured at rest (Landgraf et al. 2021)."""
_ALIKE, _OWN = 0.5, 0.2
"""Share of its energy with which something goes with the way joints came; and which must not go with where they are."""
_ORDERS = (1, 2, 3)
"""Cycles a turn of what goes with a joint's angle."""


def early_readings(look: Look) -> tuple[str, ...]:
    """Whether joints of poses were read too early, in words with the remedy; nothing where they were not."""
    linear = look.linear
    rows = np.concatenate([np.full(len(block.y_mm), isinstance(block.one.table, PoseTable)) for block in linear.blocks])
    if not rows.any():
        return ()
    taken = basis_of(np.concatenate([linear.U, *_by_angle(linear)], axis=1))

    def free(values: Array) -> Array:
        own: Array = values - taken @ (taken.T @ values)
        return own

    kinds = [(_way, "by {:.4f} ± {:.4f}°", 1.0), (_move, "by {:.3f} ± {:.3f} % of each move", 100.0)]
    fits = []
    for off, words, unit in kinds:
        whole = np.concatenate([linear.by_joint(axis, _of_joint(off, axis - 1)) for axis in range(1, 7)], axis=1)
        A = free(whole)
        y = free(_with_alike(look, A, free))
        shown = (A**2).sum(axis=0) > _OWN * (whole**2).sum(axis=0)
        ahead, sd = np.zeros(6), np.full(6, np.inf)
        inverse = np.linalg.pinv(A[np.ix_(rows, shown)])
        ahead[shown] = inverse @ y[rows]
        left = float(np.sum((y - A @ ahead)[rows] ** 2))
        sd[shown] = np.sqrt(left / rows.sum() * (inverse**2).sum(axis=1))
        share = 1 - left / max(float(np.sum(y[rows] ** 2)), 1e-300)
        fits.append((share, ahead, sd, A, words, unit))
    share, ahead, sd, A, words, unit = max(fits, key=lambda one: one[0])
    early = (ahead > _SURE * sd) & np.array([_um(look, A[:, [k]] @ ahead[[k]]) > LEAST_UM for k in range(6)])
    if share < _LEAST_SHARE or not early.any():
        return ()
    axes = ", ".join(f"axis {k + 1} {words.format(unit * ahead[k], unit * sd[k])}" for k in np.flatnonzero(early))
    what = f"poses were read before the joints stood: links are ahead of them, the way each came ({axes})"
    return (f"{what}, as no play is; wait longer before a pose is read, or import it with --joints commanded",)


def _by_angle(linear: Linear) -> list[Array]:
    """What poses show of errors that go with the angle of each joint, (N, 1 + 2 o) each."""

    def waves(joint: int, block: Block) -> Array:
        turned = block.one.path.q[:, [joint]] * np.array(_ORDERS)
        parts = np.concatenate([np.ones((len(turned), 1)), np.sin(turned), np.cos(turned)], axis=1)
        poses: Array = np.radians(parts) * isinstance(block.one.table, PoseTable)
        return poses

    return [linear.by_joint(axis, partial(waves, axis - 1)) for axis in range(1, 7)]


def _with_alike(look: Look, A: Array, free: Callable[[Array], Array]) -> Array:
    """What is left (N,), and with it what names and healthy share took up of the same shape as arrivals A (N, 6)."""
    posterior = look.posterior
    columns = posterior.background.columns
    others = np.concatenate([columns.X[:, : columns.set_ups.start], columns.X[:, columns.set_ups.stop :]], axis=1)
    mean = np.concatenate([posterior.mean[: columns.set_ups.start], posterior.mean[columns.set_ups.stop :]])
    taken = np.concatenate([others * mean, np.reshape(look.changes, (-1, len(posterior.left))).T], axis=1)
    own, basis = free(taken), basis_of(A)
    energy = (own**2).sum(axis=0)
    alike = ((basis.T @ own) ** 2).sum(axis=0) > _ALIKE * np.maximum(energy, 1e-12)
    alike &= energy > _OWN * (taken**2).sum(axis=0)
    whole: Array = posterior.left + taken[:, alike].sum(axis=1)
    return whole


def _of_joint(off: Callable[[Array], Array], joint: int) -> Callable[[Block], Array]:
    """What one joint of poses is off, (n, 1) rad at the samples of a block's path; elsewhere nothing."""

    def samples(block: Block) -> Array:
        path = block.one.path
        found = np.zeros((len(path.q), 1))
        if isinstance(block.one.table, PoseTable):
            came = np.diff(path.q[path.rows, joint], prepend=path.q[path.rows[0], joint])
            found[path.rows, 0] = off(came)
        return found

    return samples


def _way(came: Array) -> Array:
    """One degree the way that a joint came."""
    ahead: Array = np.radians(np.sign(came))
    return ahead


def _move(came: Array) -> Array:
    """As much as it came."""
    return came


def _um(look: Look, change: Array) -> float:
    poses = [isinstance(block.one.table, PoseTable) for block in look.linear.blocks]
    return float(plain_worth(look.linear, change).um[poses].max())

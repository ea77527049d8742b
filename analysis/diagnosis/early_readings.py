"""Detection of poses whose joints were read before they had come to rest.

A link that moves on after its joint was read is ahead of the reported angle, and a play holds it back, so the sign
distinguishes the two. The reversal errors of a healthy arm have the same shape and could absorb this error with a wrong
sign, so their share is added back. The direction of travel correlates with the joint angle, so whatever varies with
each joint's angle is removed first.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from analysis.diagnosis.blocks import Block
from analysis.diagnosis.linearisation import Linearisation, basis_of
from analysis.diagnosis.search import SearchResult
from analysis.diagnosis.worth import LEAST_MATERIAL_UM, plain_worth
from analysis.kinematics.arm import Array
from analysis.traces.tables import PoseTable

_SURE = 5.0
"""Smallest size of a joint's error, in standard deviations, that is reported. Among six joints, chance exceeds 5 sigma
once in a million diagnoses."""
_LEAST_SHARE = 0.2
"""Smallest share of the residual energy that must follow the direction of travel. Poses are visited in some order, so a
small share always does: 8 % in a UR10 measured at rest (Landgraf et al. 2021)."""
_ALIKE, _OWN = 0.5, 0.2
"""Chosen: a contribution counts as an arrival error when at least 0.5 of its own energy follows the direction of
travel; and at least 0.2 of its energy must remain once the dependence on joint angle is removed."""
_ORDERS = (1, 2, 3)
"""Cycles per turn of the functions of a joint's angle. Chosen: the first three orders describe gravity and eccentric
gear wheels."""


def early_readings(result: SearchResult) -> tuple[str, ...]:
    """Return a message with the remedy if the joints of poses were read too early, and an empty tuple otherwise. The N
    entries of the search result are whitened; the fitted joint errors are (6,) rad."""
    linear = result.linear
    rows = np.concatenate([np.full(len(block.y_mm), isinstance(block.one.table, PoseTable)) for block in linear.blocks])
    if not rows.any():
        return ()
    taken = basis_of(np.concatenate([linear.U, *_by_angle(linear)], axis=1))
    freedom = int(rows.sum()) - taken.shape[1] - 6
    if freedom < taken.shape[1]:  # as many terms as readings follow anything, the direction of travel too
        return ()

    def free(values: Array) -> Array:
        own: Array = values - taken @ (taken.T @ values)
        return own

    kinds = [(_way, "by {:.4f} ± {:.4f}°", 1.0), (_move, "by {:.3f} ± {:.3f} % of each move", 100.0)]
    fits = []
    for off, words, unit in kinds:
        whole = np.concatenate([linear.by_joint(axis, _of_joint(off, axis - 1)) for axis in range(1, 7)], axis=1)
        A = free(whole)
        y = free(_with_alike(result, A, free))
        shown = (A**2).sum(axis=0) > _OWN * (whole**2).sum(axis=0)
        ahead, sd = np.zeros(6), np.full(6, np.inf)
        inverse = np.linalg.pinv(A[np.ix_(rows, shown)])
        ahead[shown] = inverse @ y[rows]
        left = float(np.sum((y - A @ ahead)[rows] ** 2))
        sd[shown] = np.sqrt(left / freedom * (inverse**2).sum(axis=1))
        share = 1 - left / max(float(np.sum(y[rows] ** 2)), 1e-300)
        fits.append((share, ahead, sd, A, words, unit))
    share, ahead, sd, A, words, unit = max(fits, key=lambda one: one[0])
    early = (ahead > _SURE * sd) & np.array([_um(result, A[:, [k]] @ ahead[[k]]) > LEAST_MATERIAL_UM for k in range(6)])
    if share < _LEAST_SHARE or not early.any():
        return ()
    axes = ", ".join(f"axis {k + 1} {words.format(unit * ahead[k], unit * sd[k])}" for k in np.flatnonzero(early))
    what = f"poses were read before the joints came to rest: links are ahead in the direction of travel ({axes})"
    return (f"{what}, unlike with a play; wait longer before reading a pose, or import with --joints commanded",)


def _by_angle(linear: Linearisation) -> list[Array]:
    """Return what errors that vary with each joint's angle change in pose readings, a list of (N, 1 + 2 o) arrays."""

    def waves(joint: int, block: Block) -> Array:
        turned = block.one.path.q[:, [joint]] * np.array(_ORDERS)
        parts = np.concatenate([np.ones((len(turned), 1)), np.sin(turned), np.cos(turned)], axis=1)
        poses: Array = np.radians(parts) * isinstance(block.one.table, PoseTable)
        return poses

    return [linear.by_joint(axis, partial(waves, axis - 1)) for axis in range(1, 7)]


def _with_alike(result: SearchResult, A: Array, free: Callable[[Array], Array]) -> Array:
    """Return the residual (N,) plus those contributions of names and of the healthy share that have the shape of the
    arrival errors A (N, 6), and the curves of joints."""
    posterior = result.posterior
    columns = posterior.background.columns
    others = np.concatenate([columns.X[:, : columns.set_ups.start], columns.X[:, columns.set_ups.stop :]], axis=1)
    mean = np.concatenate([posterior.mean[: columns.set_ups.start], posterior.mean[columns.set_ups.stop :]])
    taken = np.concatenate([others * mean, np.reshape(result.contributions, (-1, len(posterior.residual))).T], axis=1)
    own, basis = free(taken), basis_of(A)
    energy = (own**2).sum(axis=0)
    alike = ((basis.T @ own) ** 2).sum(axis=0) > _ALIKE * np.maximum(energy, 1e-12)
    alike &= energy > _OWN * (taken**2).sum(axis=0)
    # The sum of many waves takes what goes with the way a joint came, and no single one of them resembles it.
    alike[columns.curves.columns] = True
    whole: Array = posterior.residual + taken[:, alike].sum(axis=1)
    return whole


def _of_joint(off: Callable[[Array], Array], joint: int) -> Callable[[Block], Array]:
    """Return a function of a block that gives the error of one joint of poses, (n, 1) rad at the samples of the block's
    path, and zero for other tests."""

    def samples(block: Block) -> Array:
        path = block.one.path
        found = np.zeros((len(path.q), 1))
        if isinstance(block.one.table, PoseTable):
            came = np.diff(path.q[path.rows, joint], prepend=path.q[path.rows[0], joint])
            found[path.rows, 0] = off(came)
        return found

    return samples


def _way(came: Array) -> Array:
    """Return one degree (n,) rad in the direction of the joint motion `came` (n,) rad."""
    ahead: Array = np.radians(np.sign(came))
    return ahead


def _move(came: Array) -> Array:
    """Return the joint motion itself, (n,) rad."""
    return came


def _um(result: SearchResult, change: Array) -> float:
    """Return the largest root mean square in µm that a change (N,) of the whitened readings has in any block
    of poses."""
    poses = [isinstance(block.one.table, PoseTable) for block in result.linear.blocks]
    return float(plain_worth(result.linear, change).um[poses].max())

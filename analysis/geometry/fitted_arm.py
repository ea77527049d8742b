"""All constants of an arm by places that it reached, least squares: what a controller computed comes out to its last
digit, what an instrument measured does not.

Unknown are a, alpha, beta, d and the zero of each axis, where the instrument stands, and the place of its target; what
the places do not distinguish stays as it was nominally, or moves least (Marquardt).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from analysis.geometry.pose_setup import fit_setup, frame
from analysis.geometry.rigid import moved_by
from analysis.kinematics.arm import Arm, Array, forward

_STEP = 1e-5
_ROUNDS = 30
REACH_MM = 500.0
"""A turn counts as the way at this distance, so that all unknowns are lengths in mm."""
_LEAST_DAMPING, _MOST_DAMPING = 1e-10, 1e2
_ENOUGH = 1e-3
"""Share of the misfit that a further step must gain."""
_DETERMINED = 1e-6
"""Share of the largest singular value from which on a direction is an unknown."""
_FIELDS = (("a", 1.0), ("alpha", REACH_MM), ("beta", REACH_MM), ("d", 1.0), ("offset", REACH_MM))


@dataclass(frozen=True)
class FittedArm:
    """An arm of which all constants are fitted. left_mm (n,): what remains of the readings; spare: readings beyond the
    unknowns."""

    arm: Arm
    left_mm: Array
    spare: int

    @property
    def rms_mm(self) -> float:
        """The root mean square of a place's distance, three readings, corrected for the unknowns."""
        return float(np.sqrt(3 * (self.left_mm**2).sum() / max(self.spare, 1)))


def fit_arm(bare: Arm, q: Array, xyz_mm: Array) -> FittedArm:
    """Return the arm, from its nominal constants, whose target is at places xyz_mm (n, 3) at joints q (n, axes) rad;
    its T_world_base has where the instrument stands, its T_flange_tool the target."""
    start = fit_setup(forward(bare, q), xyz_mm)
    begin = replace(bare, T_world_base=start.T_world_base, T_flange_tool=start.T_flange_tool)

    def changed(change: Array) -> Arm:
        shift, turn, target = change[-9:-6], change[-6:-3] / REACH_MM, change[-3:]
        T_flange_tool = begin.T_flange_tool @ frame(np.eye(3), target)
        arm = _with_constants(begin, change[:-9])
        return replace(arm, T_world_base=moved_by(arm.T_world_base, shift, turn), T_flange_tool=T_flange_tool)

    return _fitted(changed, len(_FIELDS) * bare.axes + 9, lambda arm: (xyz_mm - forward(arm, q)[:, :3, 3]).ravel())


def fit_constants(arm: Arm, q: Array, xyz_mm: Array, R: Array | None) -> FittedArm:
    """Return the arm with constants by which its tool is at places xyz_mm (n, 3), and turned as R (n, 3, 3) where
    given, at joints q (n, axes) rad: base and tool stay as they are."""

    def left(candidate: Arm) -> Array:
        T = forward(candidate, q)
        parts = [(xyz_mm - T[:, :3, 3]).ravel()]
        return np.concatenate(parts if R is None else [*parts, REACH_MM * (R - T[:, :3, :3]).ravel() / np.sqrt(3)])

    return _fitted(lambda change: _with_constants(arm, change), len(_FIELDS) * arm.axes, left)


def _with_constants(arm: Arm, change: Array) -> Arm:
    """An arm with its constants changed by (5 axes,) mm."""
    parts = change.reshape(len(_FIELDS), arm.axes)
    return replace(
        arm, **{name: getattr(arm, name) + part / reach for (name, reach), part in zip(_FIELDS, parts, strict=True)}
    )


def _fitted(changed: Callable[[Array], Arm], count: int, misfit: Callable[[Arm], Array]) -> FittedArm:
    """The arm of so many changes in mm that leaves least, in mm."""
    change, damping = np.zeros(count), _LEAST_DAMPING
    residual, J = misfit(changed(change)), np.empty((0, count))
    for _ in range(_ROUNDS):
        J = np.stack([(misfit(changed(change + step)) - residual) / _STEP for step in _STEP * np.eye(count)], axis=1)
        normal, gradient = J.T @ J, J.T @ residual
        before, gained = float(residual @ residual), 0.0
        while damping <= _MOST_DAMPING and gained <= 0:
            damped = normal + damping * float(np.trace(normal)) / count * np.eye(count)
            tried = change - np.linalg.solve(damped, gradient)
            new = misfit(changed(tried))
            gained = before - float(new @ new)
            damping *= 10 if gained <= 0 else 0.1
        if gained <= 0:
            break
        change, residual, damping = tried, new, max(damping, _LEAST_DAMPING)
        if gained < _ENOUGH * before:
            break
    sizes = np.linalg.svd(J, compute_uv=False)
    return FittedArm(changed(change), residual, residual.size - int((sizes > _DETERMINED * sizes[0]).sum()))

"""The whole model projected onto the constants that a controller has.

A controller's zeros and lengths cannot follow a soft joint or a gear, and still take up a part of what these do to the
tool. The error of the tool at the postures of the work, place and turn together, is fitted by the constants:

- Postures of the work count most. Others, spread over the joint angles for which the model is known, count enough that
  constants are not bent to the work and wrong beside it.
- A turn of the tool counts as the distance by which it moves the end of the tool, or a point at 100 mm on a short one.
- Each constant is expected within a few of its usual sizes. What no constant holds counts as scatter of the postures,
  so that a large value is never made up for a small gain.
- Constants that do the same at these postures (d2 and d3 of parallel axes) share it by their usual sizes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.correction.work import tool_poses
from analysis.kinematics.arm import Array, Mask, pose_error
from analysis.model.predict import model_of
from rigs.effects import Effect, changed, turned
from rigs.rig import Rig

_LEVER_MM = 100.0
"""Shortest lever by which a turn of the tool counts. Chosen: about half a hand's width beyond a flange."""
_USUAL = 3.0
"""Sizes of a healthy arm that a constant is expected within. Chosen: an arm that is corrected is not quite healthy."""
_LEAST_MM = 1e-3
"""Root mean square over the work, in mm, that a constant must do to be entered, and that a combination of constants of
the expected sizes must do to be known. Chosen: 1 µm, below any robot's repeatability."""
_CRUMB = 0.01
"""Part of the error, of 1, that a constant must do to be entered: who enters values by hand should not enter crumbs."""
_BESIDE = 0.1
"""Weight of the postures beside the work, of 1 for all. By trial on ur10e, a joint soft and one wavy: 0 left 93 µm on
the work and 696 µm beside it (582 before), 0.1 left 134 and 329, 0.5 left 178 and 239."""
_SHARE = 0.3
"""Part of a constant in an unknown combination, of 1, from which they are named together."""
_ROUNDS = 4
"""Linear steps. Chosen: each leaves about a thousandth, since constants are wrong by about a thousandth."""


@dataclass(frozen=True)
class Constant:
    """A constant that a controller has: the axis from 1 and the key as in the rig file; `q_deg` is a joint's zero."""

    axis: int
    key: str

    def effect(self, value: float) -> Effect:
        """Return the effect of a change by `value`, in mm or degrees."""
        return turned(self.axis, value) if self.key == "q_deg" else changed(self.axis, self.key, value)

    @property
    def usual(self) -> float:
        """The size, mm or degrees, within which a change is expected."""
        return _USUAL * self.effect(0.0).healthy


@dataclass(frozen=True)
class Projection:
    """Constants (m) with the changes `values` (m,) in mm or degrees that hold most of a model's error.

    `worth_mm` (m,) is by how much each moves the tool's place, root mean square over the work. `operator` (m, 6n)
    makes changes of the tool's error at them, weighted by `weights` (n, 6). `twins` lists places in `constants` of
    those that do the same.
    """

    constants: tuple[Constant, ...]
    values: Array
    worth_mm: Array
    operator: Array
    weights: Array
    twins: tuple[tuple[int, ...], ...]

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The changes as effects of the nominal arm: the arm that the controller then computes with."""
        return tuple(
            constant.effect(value) for constant, value in zip(self.constants, self.values.tolist(), strict=True)
        )

    def u(self, moves: Array) -> Array:
        """Return the standard uncertainty (m,), mm or degrees, of the changes, from displacements (k, n, 6) mm and rad
        of the tool by one standard uncertainty each."""
        weighted = (moves * self.weights).reshape(len(moves), self.weights.size)  # of no moves, too
        u: Array = np.sqrt(((weighted @ self.operator.T) ** 2).sum(axis=0))
        return u


def project(
    rig: Rig, effects: Sequence[Effect], constants: Sequence[Constant], work: Array, spread: Array
) -> Projection:
    """Return the changes of constants that hold most of what effects do to the tool at joint angles of the work (n, 6)
    rad and at others beside it (k, 6) rad. Constants that do nothing there are left out."""
    lever = max(_LEVER_MM, float(np.linalg.norm(rig.robot.tool.xyz_mm)))
    shares = np.repeat([(1 - _BESIDE) / len(work), _BESIDE / len(spread)], [len(work), len(spread)])
    weights = np.sqrt(shares)[:, None] * [1, 1, 1, lever, lever, lever]
    q = np.concatenate([work, spread])
    base, real = tool_poses(model_of(rig, ()), q), tool_poses(model_of(rig, effects), q)
    least_mm = max(_LEAST_MM, _CRUMB * float(np.linalg.norm(pose_error(base, real) * weights)))
    first = _solved(rig, real, constants, q, weights)
    moves = [pose_error(base, tool_poses(model_of(rig, [effect]), q)) * weights for effect in first.effects]
    kept = [constant for constant, move in zip(first.constants, moves, strict=True) if np.linalg.norm(move) >= least_mm]
    solved = _solved(rig, real, kept, q, weights)
    each = [tool_poses(model_of(rig, [effect]), work) - base[: len(work)] for effect in solved.effects]
    worth_mm = [float(np.linalg.norm(move[:, :3, 3])) / np.sqrt(len(work)) for move in each]
    return replace(solved, worth_mm=np.array(worth_mm))


def _solved(rig: Rig, real: Array, constants: Sequence[Constant], q: Array, weights: Array) -> Projection:
    base = tool_poses(model_of(rig, ()), q)
    usual = np.array([constant.usual for constant in constants])
    columns = np.zeros((6 * len(q), len(constants)))
    for k, constant in enumerate(constants):
        columns[:, k] = (
            pose_error(base, tool_poses(model_of(rig, [constant.effect(constant.usual)]), q)) * weights
        ).ravel()
    u, s, vt = np.linalg.svd(columns, full_matrices=False)
    determined = s > _LEAST_MM
    error = (pose_error(base, real) * weights).ravel()
    explained = u[:, determined] @ (u[:, determined].T @ error)
    scatter = float(((error - explained) ** 2).sum()) / len(q)
    shrunk = s[determined] / (s[determined] ** 2 + scatter)
    operator = (vt[determined].T * shrunk) @ u[:, determined].T
    sizes = np.zeros(len(constants))
    for _ in range(_ROUNDS):
        now = tool_poses(model_of(rig, [c.effect(v) for c, v in zip(constants, usual * sizes, strict=True)]), q)
        residual = (pose_error(now, real) * weights).ravel()
        sizes = operator @ (residual + columns @ sizes)
    return Projection(
        tuple(constants),
        usual * sizes,
        np.zeros(len(constants)),
        operator * usual[:, None],
        weights,
        _twins(vt, determined, len(constants)),
    )


def _twins(vt: Array, determined: Mask, count: int) -> tuple[tuple[int, ...], ...]:
    """Return which of some constants only their combination is known of."""
    # Directions without any effect are determined up to a turn among themselves, so all of them are taken together.
    unknown = vt[~determined]
    shared = unknown.T @ unknown
    groups: list[tuple[int, ...]] = []
    for k in range(count):
        group = tuple(int(j) for j in np.flatnonzero(np.abs(shared[k]) > _SHARE * shared[k, k]))
        if shared[k, k] > _SHARE and len(group) > 1 and group not in groups:
            groups.append(group)
    return tuple(groups)

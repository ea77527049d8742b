"""Map of the work area: the expected error of a part at each possible place.

The nodes of a horizontal grid are reached with a fixed orientation of the tool. A part covers several nodes and is
processed in one branch, so its error is the rms over its nodes in the best branch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.apps.postures.candidates import Candidates, find_candidates
from analysis.apps.postures.expected_error import expected_errors
from analysis.robot.kinematics.arm import Array, arm_of
from rigs.rig import Rig

_NODES = 21
"""Nodes along each side of the map. Chosen: one every 130 mm for an arm with a reach of 1.3 m."""


@dataclass(frozen=True)
class WorkMap:
    """Expected error of a part by the place of its centre in the world."""

    x_mm: Array
    y_mm: Array
    z_mm: float
    part_mm: Array
    expected_mm: Array
    """Rms error (y, x), NaN where the part cannot be processed."""

    @property
    def best_mm(self) -> tuple[float, float] | None:
        """Centre x, y of the best place; None if the part fits nowhere."""
        if not np.isfinite(self.expected_mm).any():
            return None
        row, column = np.unravel_index(int(np.nanargmin(self.expected_mm)), self.expected_mm.shape)
        return float(self.x_mm[column]), float(self.y_mm[row])

    def at(self, x_mm: float, y_mm: float) -> float:
        """Expected error in mm at the node nearest to a place, NaN if there is none."""
        column, row = int(np.abs(self.x_mm - x_mm).argmin()), int(np.abs(self.y_mm - y_mm).argmin())
        step = self.x_mm[1] - self.x_mm[0]
        near = abs(self.x_mm[column] - x_mm) <= step and abs(self.y_mm[row] - y_mm) <= step
        return float(self.expected_mm[row, column]) if near else float("nan")


def work_map(rig: Rig, part_mm: Array, pose: Array, near: Array, taught: Array | None = None) -> WorkMap:
    """Map a part (3,) mm processed with the orientation and at the height of a tool pose (4, 4).

    near: reference posture (axes,) rad for full turns. taught: postures at which frame and tool are taught.
    """
    arm = arm_of(rig.robot)
    # An upper bound of the distance of the tool from axis 1
    reach = float(np.hypot(arm.a, arm.d)[1:].sum() + np.linalg.norm(arm.T_flange_tool[:3, 3]))
    step = 2 * reach / (_NODES - 1)
    side = np.linspace(-reach, reach, _NODES)
    x_mm, y_mm = arm.T_world_base[0, 3] + side, arm.T_world_base[1, 3] + side
    heights = np.unique(pose[2, 3] + np.array([-0.5, 0.5]) * part_mm[2])
    layers = [_node_errors(rig, np.stack(np.meshgrid(x_mm, y_mm), axis=-1), z, pose, near, taught) for z in heights]
    square = np.stack(layers)
    half = [max(0, round(size / 2 / step)) for size in part_mm[:2]]
    return WorkMap(x_mm, y_mm, float(pose[2, 3]), part_mm, np.sqrt(_of_parts(square, half[0], half[1])))


def _node_errors(rig: Rig, xy: Array, z: float, pose: Array, near: Array, taught: Array | None) -> Array:
    """Square of the expected error (y, x, branch) mm² at nodes xy (y, x, 2) mm, infinite out of reach."""
    nodes = xy.reshape(-1, 2)
    poses = np.tile(pose, (len(nodes), 1, 1))
    poses[:, :2, 3], poses[:, 2, 3] = nodes, z
    candidates = _nearest_turns(find_candidates(arm_of(rig.robot), poses, near), near)
    expected = expected_errors(rig, candidates.q, taught).expected_mm if len(candidates.q) else np.zeros(0)
    square = np.full((len(nodes), 8), np.inf)
    np.minimum.at(square, (candidates.target, np.maximum(candidates.branch, 0)), expected**2)
    return square.reshape(*xy.shape[:2], 8)


def _nearest_turns(candidates: Candidates, near: Array) -> Candidates:
    """A single posture of each solution, with the turns nearest to a reference posture."""
    away = np.abs(candidates.q[:, : len(near)] - near).max(axis=1)
    order = np.lexsort((away, candidates.solution))
    _, first = np.unique(candidates.solution[order], return_index=True)
    return candidates.of(np.sort(order[first]))


def _of_parts(square: Array, half_x: int, half_y: int) -> Array:
    """Mean square error (y, x) of parts that extend over half_x and half_y nodes to each side, in the best branch.

    square: (layer, y, x, branch).
    """
    padding = ((half_y, half_y), (half_x, half_x), (0, 0))
    padded = np.pad(square.mean(axis=0), padding, constant_values=np.inf)
    windows = np.lib.stride_tricks.sliding_window_view(padded, (2 * half_y + 1, 2 * half_x + 1), axis=(0, 1))
    best = windows.mean(axis=(3, 4)).min(axis=2)
    return np.where(np.isfinite(best), best, np.nan)

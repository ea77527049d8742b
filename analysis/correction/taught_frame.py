"""Errors with a frame and a tool that are taught with the robot itself, in which a rigid motion of the whole arm and a
shift of the tool on the flange do not show.

A tracker or a ball cannot show where an arm stands on its base, nor where its target sits on the last link: the zero of
joint 1, the height of the shoulder and the length of the last link show in no run, and neither in work whose frame and
tool centre were taught with the same arm. So an error over the work is stated after these nine terms were taken out, by
least squares over the places of the tool, as set-ups are fitted everywhere else.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from analysis.geometry.rigid import best_rigid, in_frame
from analysis.kinematics.arm import Array

_SAME = 1e-9
"""Part of the largest singular value from which places show no turn: those of one point, or along one line."""


@dataclass(frozen=True)
class TaughtFrame:
    """A frame and a tool taught at `poses` (n, 4, 4) of the tool, places in mm."""

    poses: Array

    @cached_property
    def _middle(self) -> Array:
        middle: Array = self.poses[:, :3, 3].mean(axis=0)
        return middle

    @cached_property
    def _lever_mm(self) -> float:
        """Root mean square distance from the middle, by which a turn counts as much as a shift."""
        return max(1.0, float(np.sqrt(((self.poses[:, :3, 3] - self._middle) ** 2).sum(axis=1).mean())))

    def _columns(self, poses: Array) -> Array:
        """Return what shifts in mm, turns about the middle, in mm at the lever, and shifts of the tool on the flange in
        mm do (n, 3, 9) at poses (n, 4, 4)."""
        shifts = np.tile(np.eye(3), (len(poses), 1, 1))
        turns = np.cross(np.eye(3)[None], ((poses[:, :3, 3] - self._middle) / self._lever_mm)[:, None, :])
        return np.concatenate([shifts, turns.transpose(0, 2, 1), poses[:, :3, :3]], axis=2)

    def motions(self, moves: Array) -> Array:
        """Return the small motions (k, 9) closest to displacements (k, n, 3) mm at the poses of the frame."""
        columns = self._columns(self.poses)
        inverse = np.linalg.pinv(columns.reshape(-1, columns.shape[2]), _SAME)
        motions: Array = moves.reshape(len(moves), inverse.shape[1]) @ inverse.T
        return motions

    def rest(self, moves: Array, poses: Array, motions: Array) -> Array:
        """Return displacements (k, n, 3) mm at poses (n, 4, 4) without motions (k, 9)."""
        displacements: Array = moves - np.einsum("nij,kj->kni", self._columns(poses), motions)
        return displacements


def rest_mm(places: Array, nominal: Array) -> Array:
    """Return how far (n,) mm places (n, 3) mm are from those of the wanted poses (n, 4, 4), with the frame and the tool
    with which they fit best."""
    T = best_rigid(places, nominal[:, :3, 3])  # exact for a large turn, about which the other terms are linear
    moves = (in_frame(T, places) - nominal[:, :3, 3])[None]
    frame = TaughtFrame(nominal)
    distances_mm: Array = np.linalg.norm(frame.rest(moves, nominal, frame.motions(moves))[0], axis=1)
    return distances_mm


def base_u_um(u_mm: Array, u_frame_mm: Array) -> float:
    """Return what the place of the whole arm on its base adds, root mean square in µm, to the uncertainty of places
    with standard uncertainty (n,) mm in the robot's base and (n,) mm in a taught frame."""
    return 1e3 * float(np.sqrt(max(0.0, float(np.mean(u_mm**2 - u_frame_mm**2)))))

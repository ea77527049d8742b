"""Errors in a frame that is taught with the robot itself, in which a rigid motion of the whole arm does not show.

A tracker or a ball cannot show where an arm stands on its base: the zero of joint 1, the height of the shoulder and the
like show in no run, and neither in work whose frame was taught with the same arm. So an error over the work is stated
after the rigid motion that fits it best was taken out, six numbers by least squares over the places of the tool.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from analysis.geometry.rigid import best_rigid
from analysis.kinematics.arm import Array

_SAME = 1e-9
"""Part of the largest singular value from which places show no turn: those of one point, or along one line."""


@dataclass(frozen=True)
class TaughtFrame:
    """A frame taught at `places` (n, 3) mm of the tool."""

    places: Array

    @cached_property
    def _middle(self) -> Array:
        middle: Array = self.places.mean(axis=0)
        return middle

    @cached_property
    def _lever_mm(self) -> float:
        """Root mean square distance from the middle, by which a turn counts as much as a shift."""
        return max(1.0, float(np.sqrt(((self.places - self._middle) ** 2).sum(axis=1).mean())))

    def _columns(self, places: Array) -> Array:
        """Return what shifts in mm and turns about the middle, in mm at the lever, do (n, 3, 6) at places (n, 3) mm."""
        shifts = np.tile(np.eye(3), (len(places), 1, 1))
        turns = np.cross(np.eye(3)[None], ((places - self._middle) / self._lever_mm)[:, None, :])
        return np.concatenate([shifts, turns.transpose(0, 2, 1)], axis=2)

    def motions(self, moves: Array) -> Array:
        """Return the small rigid motions (k, 6) closest to displacements (k, n, 3) mm at the places of the frame."""
        inverse = np.linalg.pinv(self._columns(self.places).reshape(-1, 6), _SAME)
        found: Array = moves.reshape(len(moves), inverse.shape[1]) @ inverse.T
        return found

    def rest(self, moves: Array, places: Array, motions: Array) -> Array:
        """Return displacements (k, n, 3) mm at places (n, 3) mm without rigid motions (k, 6)."""
        left: Array = moves - np.einsum("nij,kj->kni", self._columns(places), motions)
        return left


def rest_mm(places: Array, wanted: Array) -> Array:
    """Return how far (n,) mm places (n, 3) mm are from where they are wanted (n, 3) mm, in the frame in which they fit
    best."""
    T = best_rigid(places, wanted)
    left: Array = np.linalg.norm(places @ T[:3, :3].T + T[:3, 3] - wanted, axis=1)
    return left


def base_u_um(u_mm: Array, u_frame_mm: Array) -> float:
    """Return what the place of the whole arm on its base adds, root mean square in µm, to the uncertainty of places
    with standard uncertainty (n,) mm in the robot's base and (n,) mm in a taught frame."""
    return 1e3 * float(np.sqrt(max(0.0, float(np.mean(u_mm**2 - u_frame_mm**2)))))

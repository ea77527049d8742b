"""How near an arm is to a singularity, and which axes make it."""

from __future__ import annotations

import numpy as np

from analysis.kinematics.arm import Arm, Array, forward_and_jacobian
from analysis.kinematics.newton import LENGTH_MM

_TAKES_PART = 0.1
"""An axis takes part in a singularity with at least this share of a unit joint motion that leaves the tool still."""


def conditioning(arm: Arm, q: Array) -> Array:
    """Smallest over largest singular value (n,) of the Jacobian at q (n, 6) rad: 0 is a singularity, 1 isotropic.

    A radian of tool rotation counts as 500 mm; the joints are those of the controller.
    """
    return null_motion(arm, q)[0]


def null_motion(arm: Arm, q: Array) -> tuple[Array, Array]:
    """The conditioning (n,) at q (n, 6) rad, and the unit joint motion (n, 6) that moves the tool least."""
    J = forward_and_jacobian(arm, q)[1]
    J[:, 3:] *= LENGTH_MM
    _, values, motions = np.linalg.svd(J)
    return values[:, -1] / values[:, 0], motions[:, -1]


def cancelling_axes(arm: Arm, q: Array) -> list[int]:
    """The axes (1 … 6) whose motions come nearest to leaving the tool still, at q (6,) rad.

    4 and 6 is the wrist singularity, 2, 3 and 5 a stretched elbow arm.
    """
    _, still = null_motion(arm, q[None])
    return [int(axis) + 1 for axis in np.flatnonzero(np.abs(still[0]) > _TAKES_PART)]

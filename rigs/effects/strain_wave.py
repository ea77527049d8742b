"""Torsion of a strain-wave gear: soft at small torque, stiffer beyond two knees, with a loss between loading and
unloading.

Makers state the stiffness in three regions of the torque: K1 up to T1, K2 up to T2, K3 beyond, and the hysteresis loss
(Harmonic Drive SE, catalogue of the units CSG, HFUC and SHG, ratios from 80). T1 and T2 in Nm, K1, K2 and K3 in 10⁴
Nm/rad, from memory and not yet compared with the catalogue:

    size     14     17     20     25     32     40
    T1      2.0    3.9    7.0     14     29     54
    T2      6.9     12     25     48    108    196
    K1     0.47    1.0    1.6    3.1    6.7     13
    K2     0.61    1.4    2.5    5.0     11     20
    K3     0.71    1.6    2.9    5.7     12     23

So the sizes are one curve: T2 / T1 is 3.1 to 3.7, K2 / K1 1.3 to 1.6 and K3 / K1 1.5 to 1.8.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from rigs.schema.effect import (
    AT_AXIS,
    BY_TARGETS,
    Compensation,
    Effect,
    Scope,
    StretchedShape,
    at_each_axis,
    shape,
    size,
)
from rigs.schema.part import Axis
from rigs.schema.scene import Array, S, play
from rigs.schema.vocabulary import Build

_KNEE_2, _K2, _K3 = 3.5, 1.55, 1.75
"""T2 / T1, K2 / K1 and K3 / K1: means of sizes 17 to 40 of the table."""
_KNEES_NM = (5.0, 14.0, 40.0)
"""T1 of the forms that are tried: between sizes 17 and 20, size 25, and between sizes 32 and 40, as in shoulders and
elbows of arms that carry 3 to 16 kg. A fit then adjusts it."""
_LOSS = 0.3
"""Half the hysteresis loss over the twist at T1. The catalogue states a loss of 2.9e-4 rad at full load for sizes from
20, and the twist T1 / K1 is 4.2 to 4.5e-4 rad for all sizes: half of 2.9 over 4.3 is 0.34, less at part of the load."""
_AXES = (2, 3)
"""Axes that carry enough to pass a knee: shoulder and elbow. Within the first region it is a linear softness."""


def three_regions(torque: Array, knee: float) -> Array:
    """Return a torque (n,) Nm as that which would twist a gear as far whose stiffness is everywhere that of the first
    region, up to the torque knee."""
    load = np.abs(torque)
    first, second = np.minimum(load, knee), np.clip(load - knee, 0.0, (_KNEE_2 - 1) * knee)
    third = np.maximum(load - _KNEE_2 * knee, 0.0)
    alike: Array = np.sign(torque) * (first + second / _K2 + third / _K3)
    return alike


class StrainWave(Effect):
    """Twist of a strain-wave gear: `deg_per_Nm` up to `knee_Nm`, two thirds of it above, less beyond 3.5 knees.

    loss: half the hysteresis loss over the twist at the knee: the gear follows its torque as in a play of it.
    """

    effect: Literal["strain_wave"] = "strain_wave"
    axis: Axis
    deg_per_Nm: float = size(0.05, 1e-5, least=0.0)
    """Healthy: a fifth of a linear softness; machines have cycloidal gears, and little of their softness has knees."""
    knee_Nm: float = shape(0.1, 1e4, 40.0)
    loss: float = shape(0, 2, 0.0)

    STAGE = "joint"
    DEED = "enter"
    PART = "gravity"
    PLACE = AT_AXIS
    STRETCHED = (StretchedShape("knee_Nm", 0.5, low=1.0), StretchedShape("loss", 0.5, least=1e-6))
    MOST = 5000.0
    """As soft as a rig file may state an axis, as a linear softness (`compliance`)."""

    def apply(self, scene: S) -> S:
        """The gear twists in the direction in which gravity pulls; what turns the torque back has to pass the loss."""
        torque = scene.torques()[:, self.axis - 1]
        if self.loss:
            torque = play(torque, self.loss * self.knee_Nm)
        return scene.turned(self.axis, np.radians(self.deg_per_Nm) * three_regions(torque, self.knee_Nm))

    @classmethod
    def forms(cls, scope: Scope) -> list[list[StrainWave]]:
        """Three sizes at shoulder and elbow, with a loss if the whole motion is known."""
        loss = _LOSS if scope.timed else 0.0
        at_axes = [[form for (form,) in at_each_axis(cls, scope, knee_Nm=knee, loss=loss)] for knee in _KNEES_NM]
        return [[forms[axis - 1] for forms in at_axes] for axis in _AXES if axis in scope.axes]

    def plain(self, joint: str) -> str:
        return f"torsion of the strain-wave gear of {joint}"

    def remedy(self) -> str:
        return (
            f"the gear of axis {self.axis} twists by {1e6 * np.radians(self.deg_per_Nm):.3g} µrad/Nm up to "
            f"{self.knee_Nm:.3g} Nm and less beyond: enter the payload as it is, and correct targets"
        )

    def compensation(self) -> Compensation:
        """It depends on the posture, and by its loss a little on the way there."""
        return BY_TARGETS

    def usual_times(self, build: Build) -> float:
        """Light arms have strain-wave gears: as much as their linear softness (`compliance`, a UR10's axes 2 and 3),
        6e-4 °/Nm. Arms with sensors of torque have the same gears."""
        return 60.0 if build in ("light", "torque_sensing") else 1.0

    @property
    def idle(self) -> str:
        """It shows where a joint carries much."""
        return f"gravity hardly loads axis {self.axis}"

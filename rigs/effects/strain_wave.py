"""Torsion of a strain-wave gear: soft at small torque, stiffer beyond two knees, with a loss between loading and
unloading.

Makers specify the stiffness in three regions of the torque (K1 up to T1, K2 up to T2, K3 beyond) and the hysteresis
loss (Harmonic Drive SE, catalogue of the units CSG, HFUC and SHG, ratios from 80). T1 and T2 are in Nm; K1, K2 and K3
in 10⁴ Nm/rad. The numbers are from memory and not yet compared with the catalogue:

    size     14     17     20     25     32     40
    T1      2.0    3.9    7.0     14     29     54
    T2      6.9     12     25     48    108    196
    K1     0.47    1.0    1.6    3.1    6.7     13
    K2     0.61    1.4    2.5    5.0     11     20
    K3     0.71    1.6    2.9    5.7     12     23

All sizes therefore follow the same curve: T2 / T1 is 3.1 to 3.7, K2 / K1 1.3 to 1.6 and K3 / K1 1.5 to 1.8.
"""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np

from rigs.schema.effect import (
    AT_AXIS,
    BY_TARGETS,
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
"""T2 / T1, K2 / K1 and K3 / K1: means over sizes 17 to 40 of the table."""
_KNEES_NM = (5.0, 14.0, 40.0)
"""T1 in the forms: between sizes 17 and 20, size 25, and between 32 and 40, for arms with a payload of 3 to 16 kg."""
_LOSS = 0.3
"""Half of the hysteresis loss relative to the twist at T1: the catalogue gives a loss of 2.9e-4 rad at full load for
sizes from 20, and a twist T1 / K1 of 4.2 to 4.5e-4 rad. Half of 2.9 / 4.3 is 0.34, and less at partial load.
"""
_AXES = (2, 3)
"""Axes with enough load to exceed a knee: shoulder and elbow.

Within the first region the effect is a linear compliance.
"""


def three_regions(torque: Array, knee: float) -> Array:
    """Torque (n,) in Nm that gives the same twist if the stiffness of the first region applies throughout.

    torque (n,): actual torque in Nm. knee: T1 in Nm.
    """
    load = np.abs(torque)
    first, second = np.minimum(load, knee), np.clip(load - knee, 0.0, (_KNEE_2 - 1) * knee)
    third = np.maximum(load - _KNEE_2 * knee, 0.0)
    alike: Array = np.sign(torque) * (first + second / _K2 + third / _K3)
    return alike


class StrainWave(Effect):
    """Twist of a strain-wave gear: `deg_per_Nm` up to `knee_Nm`, two thirds of it above, less beyond 3.5 knees.

    loss: half of the hysteresis loss relative to the twist at the knee. The gear follows the torque as through
    backlash.
    """

    effect: Literal["strain_wave"] = "strain_wave"
    axis: Axis
    deg_per_Nm: float = size(0.05, 1e-5, least=0.0)
    """Healthy value: a fifth of a linear compliance.

    Industrial arms have cycloidal gears with almost linear compliance.
    """
    knee_Nm: float = shape(0.1, 1e4, 40.0)
    loss: float = shape(0, 2, 0.0)

    STAGE = "joint"
    KIND_NAME = "torsion of the gear"
    USUAL_TIMES: ClassVar[dict[Build, float]] = {"light": 60.0, "torque_sensing": 60.0}
    """6e-4 °/Nm, the linear compliance of axes 2 and 3 of a UR10 (`compliance`)."""
    PLAIN = "torsion of the strain-wave gear of {joint}"
    IDLE = "gravity hardly loads axis {e.axis}"
    CORRECTION = BY_TARGETS
    SEAT_NOUN = "axis"
    DEED = "enter"
    PART = "gravity"
    PLACE = AT_AXIS
    STRETCHED = (StretchedShape("knee_Nm", 0.5, low=1.0), StretchedShape("loss", 0.5, least=1e-6))
    MOST = 5000.0
    """Softest axis allowed in a rig file, as for a linear compliance (`compliance`)."""

    def apply(self, scene: S) -> S:
        """Twist the gear in the direction of gravity. A reversal of the torque has to overcome the loss first."""
        torque = scene.torques()[:, self.axis - 1]
        if self.loss:
            torque = play(torque, self.loss * self.knee_Nm)
        return scene.turned(self.axis, np.radians(self.deg_per_Nm) * three_regions(torque, self.knee_Nm))

    @classmethod
    def forms(cls, scope: Scope) -> list[list[StrainWave]]:
        """Three sizes at shoulder and elbow, with a loss if the complete motion is known."""
        loss = _LOSS if scope.timed else 0.0
        at_axes = [[form for (form,) in at_each_axis(cls, scope, knee_Nm=knee, loss=loss)] for knee in _KNEES_NM]
        return [[forms[axis - 1] for forms in at_axes] for axis in _AXES if axis in scope.axes]

    def remedy(self) -> str:
        return (
            f"the gear of axis {self.axis} twists by {1e6 * np.radians(self.deg_per_Nm):.3g} µrad/Nm up to "
            f"{self.knee_Nm:.3g} Nm and less above: enter the actual payload, and correct targets"
        )

"""Joint compliance: torsion of the gear under the gravity torque of links and payload."""

from __future__ import annotations

from typing import Literal

import numpy as np

from rigs.schema.effect import AT_AXIS, BY_TARGETS, Effect, FreeShape, Payload, Scope, at_each_axis, shape, size
from rigs.schema.part import Axis
from rigs.schema.reference import Reference
from rigs.schema.scene import S
from rigs.schema.vocabulary import Build

_HANGS, _SPREAD, _HEAVY = 1 / 6, 0.23, 0.5
"""Unknown payload during a test as a share of the mass of the arm: first assumption, its uncertainty, and second
assumption. The rated payload is 0.12 (IRB 120) to 0.47 (iiwa 14) of the mass of arms from 0.6 to 1100 kg.
"""
_ARM_KG = 30.0
"""Mass of an arm without stated masses: a UR10 or an iiwa 14."""
_STATED_SHARE, _LEAST_SHARE = 0.03, 1 / 300
"""Uncertainty of a given payload, as a share of it, and at least of the mass of the arm. Chosen: a tool is weighed to a
few percent; cables and a ball weigh 0.1 kg at an arm of 30 kg.
"""

_SOFT_DEG_PER_NM: dict[Build, tuple[float, float]] = {
    "industrial": (5e-5, 3e-4),
    "light": (6e-4, 3e-3),
    "torque_sensing": (4.3e-3, 4.3e-3),
    "servo": (1e-2, 1e-2),
}
"""Healthy compliance of axes 1 to 3, and of the wrist.

- industrial: assumed; neither measured arms nor reducer tables were available.
- light: axes 2 and 3 of a UR10 yield 4.6 to 6.3e-4 °/Nm in four series (Landgraf et al., 2021, as fitted by rig), as
  the largest joint of an RB-Y1. Its joints of size 17 to 20, as in a wrist, yield 2.3 to 4.1e-3 °/Nm (joint
  specification of Rainbow Robotics).
- torque_sensing: a torque sensor is a spring in series. Axes 2 to 4 of an iiwa 14 yield 3.2 to 4.3e-3 °/Nm (Franzese et
  al., 2024, as fitted by rig).
- servo: after the encoder of the output shaft, assumed for horns and printed brackets.
"""


class Compliance(Effect):
    """Compliance of a joint under load: torque times `deg_per_Nm`.

    payload_kg: difference between the real payload and the rig file, down to no payload.
    """

    effect: Literal["compliance"] = "compliance"
    axis: Axis
    deg_per_Nm: float = size(0.05, 5e-5, least=0.0)
    payload_kg: float = shape(-500, 500, 0.0)

    STAGE = "joint"
    KIND_NAME = "deflection under load"
    IDLE = "gravity does not load axis {e.axis}"
    REMEDY = "axis {e.axis} deflects under load: enter the actual payload, or use the controller's compensation"
    CORRECTION = BY_TARGETS
    SEAT_NOUN = "axis"
    DEED = "enter"
    PART = "gravity"
    PLACE = AT_AXIS
    FREE = (FreeShape("payload_kg", _HANGS * _ARM_KG, _SPREAD * _ARM_KG, tried=(_HEAVY * _ARM_KG,), low=0.0),)
    MOST = 1000.0
    """Chosen: the softest axis allowed in a rig file. Joints of light arms are far softer than the healthy sizes."""

    @classmethod
    def free(cls, payload: Payload) -> tuple[FreeShape, ...]:
        """Payload as a shape to fit: a given one varies within the uncertainty of scales and cables, and further only
        if the readings contradict it, for example because the tool was not mounted. An unknown one scales with the arm.
        """
        arm_kg = payload.arm_kg or _ARM_KG
        if payload.kg <= 0:
            return (FreeShape("payload_kg", _HANGS * arm_kg, _SPREAD * arm_kg, tried=(_HEAVY * arm_kg,), low=0.0),)
        spread = max(_STATED_SHARE * payload.kg, _LEAST_SHARE * arm_kg)
        tried = (_HEAVY * arm_kg, -payload.kg)
        return (FreeShape("payload_kg", 0.0, spread, tried=tried, stated=True, low=-payload.kg),)

    def apply(self, scene: S) -> S:
        return scene.turned(self.axis, np.radians(self.deg_per_Nm) * scene.torques(self.payload_kg)[:, self.axis - 1])

    @classmethod
    def forms(cls, scope: Scope) -> list[list[Compliance]]:
        return at_each_axis(cls, scope, payload_kg=cls.free(scope.payload)[0].expected)

    @property
    def healthy(self) -> float:
        """Healthy size: 5e-5 °/Nm on axes 1 to 3, 3e-4 on the wrist. Assumed, as for reducers of industrial arms."""
        return 5e-5 if self.axis <= 3 else 3e-4

    def usual_times(self, reference: Reference) -> float:
        """Ratio to industrial arms: joints of light arms are ten times as soft."""
        return max(_SOFT_DEG_PER_NM[reference.design][self.axis > 3] / self.healthy, 1.0)

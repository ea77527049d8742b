"""Joint compliance: torsion of the gear under the gravity torque of links and payload."""

from __future__ import annotations

from typing import Literal

import numpy as np

from rigs.schema.effect import AT_AXIS, BY_TARGETS, Effect, FreeShape, Scope, at_each_axis, shape, size
from rigs.schema.part import Axis
from rigs.schema.reference import Reference
from rigs.schema.scene import S
from rigs.schema.vocabulary import Build

_HANGS_KG = 5.0
"""First assumption for an unknown payload during a test."""
_HEAVY_KG = 15.0
"""Second assumption for an unknown payload."""
_STATED_SHARE, _LEAST_KG = 0.03, 0.1
"""Uncertainty of a given payload. Chosen: a tool is weighed to a few percent; cables and a ball weigh 0.1 kg."""

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
    FREE = (FreeShape("payload_kg", _HANGS_KG, 7.0, tried=(_HEAVY_KG,), low=0.0),)
    MOST = 1000.0
    """Chosen: the softest axis allowed in a rig file. Joints of light arms are far softer than the healthy sizes."""

    @classmethod
    def free(cls, payload_kg: float) -> tuple[FreeShape, ...]:
        """Payload as a shape to fit: a given one varies within the uncertainty of scales and cables, and further only
        if the readings contradict it, for example because the tool was not mounted.
        """
        if payload_kg <= 0:
            return cls.FREE
        spread = max(_STATED_SHARE * payload_kg, _LEAST_KG)
        return (FreeShape("payload_kg", 0.0, spread, tried=(_HEAVY_KG, -payload_kg), stated=True, low=-payload_kg),)

    def apply(self, scene: S) -> S:
        return scene.turned(self.axis, np.radians(self.deg_per_Nm) * scene.torques(self.payload_kg)[:, self.axis - 1])

    @classmethod
    def forms(cls, scope: Scope) -> list[list[Compliance]]:
        return at_each_axis(cls, scope, payload_kg=cls.free(scope.payload_kg)[0].expected)

    @property
    def healthy(self) -> float:
        """Healthy size: 5e-5 °/Nm on axes 1 to 3, 3e-4 on the wrist. Assumed, as for reducers of industrial arms."""
        return 5e-5 if self.axis <= 3 else 3e-4

    def usual_times(self, reference: Reference) -> float:
        """Ratio to industrial arms: joints of light arms are ten times as soft."""
        return max(_SOFT_DEG_PER_NM[reference.design][self.axis > 3] / self.healthy, 1.0)

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np

from rigs.schema.effect import AT_AXIS, Compensation, Effect, size
from rigs.schema.part import Axis
from rigs.schema.scene import S
from rigs.schema.vocabulary import Build


class JointOffset(Effect):
    """Datum location error: link = reported + offset."""

    effect: Literal["joint_offset"] = "joint_offset"
    axis: Axis
    offset_deg: float = size(5, 0.02)

    STAGE = "joint"
    FORM_U = 0.0
    KIND_NAME = "zero"
    USUAL_TIMES: ClassVar[dict[Build, float]] = {"light": 2.0, "torque_sensing": 2.0, "servo": 10.0}
    """A multiple of two for light arms and of ten for servos.

    Zeros of axes 2 to 4 of a UR10 are wrong by up to 0.06° (Landgraf et al., 2021). Zeros of servos are set by eye
    and limited by the teeth of a horn; assumed, so that an offset of 1° is a fault.
    """
    REMEDY = "re-master axis {e.axis} (actual angle minus reading: {e.offset_deg:+z.4f}°), or enter the offset"
    SEAT_NOUN = "axis"
    DEED = "remaster"
    PART = "constants"
    PLACE = AT_AXIS
    MOST = 250.0
    """Largest offset in a rig file, 5°: the zero of a hobby servo is set by eye."""

    def apply(self, scene: S) -> S:
        return scene.turned(self.axis, np.radians(self.offset_deg))

    def compensation(self) -> Compensation:
        return Compensation("joint zero", constant=(self.axis, "q_deg"))

    @property
    def symbol(self) -> str:
        return f"zero of axis {self.axis}"

    @classmethod
    def turning(cls, axis: int, angle_deg: float) -> JointOffset:
        return cls(axis=axis, offset_deg=angle_deg)

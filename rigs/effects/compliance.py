"""Joint compliance: the gear twists under the torque of gravity, links and payload."""

from __future__ import annotations

from typing import Literal

import numpy as np

from rigs.schema.effect import AT_AXIS, BY_TARGETS, Compensation, Effect, FreeShape, Scope, at_each_axis, shape, size
from rigs.schema.part import Axis
from rigs.schema.scene import S
from rigs.schema.vocabulary import Build

_HANGS_KG = 5.0
"""Where no payload is stated it is unknown during a test: what is taken first, …"""
_HEAVY_KG = 15.0
"""… and the other end of what is tried."""
_STATED_SHARE, _LEAST_KG = 0.03, 0.1
"""How far a stated payload may be off. Chosen: a tool is weighed to a few percent; cables and a ball weigh 0.1 kg."""

_SOFT_DEG_PER_NM: dict[Build, tuple[float, float]] = {
    "industrial": (5e-5, 3e-4),
    "light": (6e-4, 3e-3),
    "torque_sensing": (4.3e-3, 4.3e-3),
    "servo": (1e-2, 1e-2),
}
"""How soft a joint of axes 1 to 3, and one of the wrist, is without a fault.

- industrial: 0.9 and 5 µrad/Nm, assumed. No measured arm and no table of its reducers stands behind them.
- light: strain-wave gears. Axes 2 and 3 of a UR10 yield 8 to 11 µrad/Nm in four series (Landgraf et al., 2021, as rig
  fits them), 4.6 to 6.3e-4 °/Nm. Rainbow Robotics states 9 µrad/Nm for the largest joint of an RB-Y1 and 20, 40, 71 and
  164 for the smaller ones (its joint specification, sizes 32 to 14): a wrist of size 17 to 20 yields 40 to 71,
  2.3 to 4.1e-3 °/Nm.
- torque_sensing: a sensor of torque is a spring in series. Axes 2 to 4 of an iiwa 14 yield 55 to 75 µrad/Nm (Franzese
  et al., 2024, as rig fits them), 3.2 to 4.3e-3 °/Nm.
- servo: 175 µrad/Nm behind the encoder of the output shaft, assumed for horns and printed brackets.
"""


class Compliance(Effect):
    """What a joint yields under load: torque times `deg_per_Nm`; by `payload_kg` more hangs at the flange than the rig
    file states, or less where it is below 0, down to nothing."""

    effect: Literal["compliance"] = "compliance"
    axis: Axis
    deg_per_Nm: float = size(0.05, 5e-5, least=0.0)
    payload_kg: float = shape(-500, 500, 0.0)

    STAGE = "joint"
    DEED = "enter"
    PART = "gravity"
    PLACE = AT_AXIS
    FREE = (FreeShape("payload_kg", _HANGS_KG, 7.0, tried=(_HEAVY_KG,), low=0.0),)
    MOST = 1000.0
    """Chosen: as soft as a rig file may state an axis (0.05 °/Nm, a spring of 1.1 kNm/rad). Joints of light arms are
    softer by far than those of machines, whose sizes are the healthy ones: fits of FR3 arms ended at 0.006 of 0.018."""

    @classmethod
    def free(cls, payload_kg: float) -> tuple[FreeShape, ...]:
        """A payload that is stated holds, within what scales and cables leave open, unless readings say otherwise: that
        more hangs there, or nothing."""
        if payload_kg <= 0:
            return cls.FREE
        spread = max(_STATED_SHARE * payload_kg, _LEAST_KG)
        return (FreeShape("payload_kg", 0.0, spread, tried=(_HEAVY_KG, -payload_kg), stated=True, low=-payload_kg),)

    def apply(self, scene: S) -> S:
        """The joint gives way in the direction in which gravity pulls it."""
        return scene.turned(self.axis, np.radians(self.deg_per_Nm) * scene.torques(self.payload_kg)[:, self.axis - 1])

    @classmethod
    def forms(cls, scope: Scope) -> list[list[Compliance]]:
        """One at each joint."""
        return at_each_axis(cls, scope, payload_kg=cls.free(scope.payload_kg)[0].expected)

    def plain(self, joint: str) -> str:
        return f"deflection under load of {joint}"

    def remedy(self) -> str:
        return f"axis {self.axis} yields under load: enter the payload as it is, or let the controller compensate"

    def compensation(self) -> Compensation:
        """It depends on the posture alone."""
        return BY_TARGETS

    @property
    def healthy(self) -> float:
        """5e-5 °/Nm on axes 1 to 3, 3e-4 on the wrist; assumed, as of a machine's reducers."""
        return 5e-5 if self.axis <= 3 else 3e-4

    def usual_times(self, build: Build) -> float:
        """Return it for the build of the arm: joints of light arms are ten times as soft as those of machines."""
        return max(_SOFT_DEG_PER_NM[build][self.axis > 3] / self.healthy, 1.0)

    @property
    def idle(self) -> str:
        """It shows where a joint carries."""
        return f"gravity does not load axis {self.axis}"

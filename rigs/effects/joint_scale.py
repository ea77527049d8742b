"""Joint scale: a joint turns by a multiple of the reported angle. Link side = reported × (1 + relative)."""

from __future__ import annotations

from typing import ClassVar, Literal

from rigs.schema.effect import AT_AXIS, BY_TARGETS, Effect, Scope, at_each_axis, size
from rigs.schema.part import Axis
from rigs.schema.scene import S
from rigs.schema.vocabulary import Build

_LEAST_TURN = 0.15
"""Minimum motion of a joint in turns, 54°. Chosen: with less, a wrong scale competed with each wrong zero."""


class JointScale(Effect):
    """Wrong gear ratio or encoder resolution: the joint turns `relative` more than reported, from its zero."""

    effect: Literal["joint_scale"] = "joint_scale"
    axis: Axis
    relative: float = size(0.2, 5e-5)
    """Healthy value: an angle of 90° is wrong by 0.0045°, as much as with a healthy gear (`transmission_error`);
    assumed. Numbers of teeth and encoder lines are integers, so a healthy ratio is exact.
    """

    STAGE = "joint"
    FORM_U = 0.0
    KIND_NAME = "gear ratio"
    USUAL_TIMES: ClassVar[dict[Build, float]] = {"servo": 30.0}
    """A multiple of thirty for hobby servos, 0.15 %: magnet and sensor are not centred; assumed."""
    CORRECTION = BY_TARGETS
    SEAT_NOUN = "axis"
    DEED = "check"
    PART = "constants"
    PLACE = AT_AXIS
    MOST = 2000.0
    """Upper limit, 10 %: ratios in a gear family differ by more (80, 100, 120), a single tooth changes 1 %."""

    def apply(self, scene: S) -> S:
        return scene.turned(self.axis, self.relative * scene.q[:, self.axis - 1])

    @classmethod
    def forms(cls, scope: Scope) -> list[list[JointScale]]:
        """A form for each joint with a large motion."""
        return [form for form in at_each_axis(cls, scope) if scope.turned[form[0].axis - 1] >= _LEAST_TURN]

    def remedy(self) -> str:
        return (
            f"axis {self.axis} turns {100 * (1 + self.relative):.3f} % of the reported angle: correct the "
            "gear ratio or the encoder resolution in the controller, then re-master the axis"
        )

    @property
    def idle(self) -> str:
        return f"axis {self.axis} turns by less than {360 * _LEAST_TURN:g}°"

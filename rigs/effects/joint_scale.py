"""Joint scale: a joint turns by another share of what its controller reports. Link side = reported × (1 + relative)."""

from __future__ import annotations

from typing import Literal

from rigs.schema.effect import AT_AXIS, BY_TARGETS, Compensation, Effect, Scope, at_each_axis, size
from rigs.schema.part import Axis
from rigs.schema.scene import S
from rigs.schema.vocabulary import Build

_LEAST_TURN = 0.15
"""Turns of a joint, 54°, above which a wrong scale and a wrong zero differ. Chosen: on laps that turn a joint by less
it was a rival of each zero, which is far likelier."""


class JointScale(Effect):
    """A wrong gear ratio or encoder resolution: the joint turns `relative` more than reported, from its zero."""

    effect: Literal["joint_scale"] = "joint_scale"
    axis: Axis
    relative: float = size(0.2, 5e-5)
    """Healthy: an angle of 90° is off by 0.0045°, as much as a healthy gear (`transmission_error`); assumed. Numbers of
    teeth and encoder lines are whole, so that a healthy ratio is exact."""

    STAGE = "joint"
    DEED = "enter"
    PART = "constants"
    PLACE = AT_AXIS
    MOST = 2000.0
    """A tenth: neighbouring ratios of a gear family differ by more (80, 100, 120), those of one tooth by 1 %."""

    def apply(self, scene: S) -> S:
        """The joint is off in proportion to its angle."""
        return scene.turned(self.axis, self.relative * scene.q[:, self.axis - 1])

    @classmethod
    def forms(cls, scope: Scope) -> list[list[JointScale]]:
        """One at each joint that turns far: on a short stretch a wrong scale is a wrong zero."""
        return [form for form in at_each_axis(cls, scope) if scope.turned[form[0].axis - 1] >= _LEAST_TURN]

    def plain(self, joint: str) -> str:
        return f"scale of {joint} (gear ratio or encoder resolution)"

    def remedy(self) -> str:
        return (
            f"axis {self.axis} turns {100 * (1 + self.relative):.3f} % of what its controller reports: correct its "
            "gear ratio or the resolution of its encoder in the controller, then re-master it"
        )

    def compensation(self) -> Compensation:
        """Depends on the posture only."""
        return BY_TARGETS

    def usual_times(self, build: Build) -> float:
        """Hobby servos thirty times, 0.15 %: their magnet and sensor are not centred; assumed."""
        return 30.0 if build == "servo" else 1.0

    @property
    def idle(self) -> str:
        """It shows where the angle of the joint changes."""
        return f"axis {self.axis} turns by less than {360 * _LEAST_TURN:g}°"

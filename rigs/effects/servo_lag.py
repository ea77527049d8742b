"""Servo lag: where the feedback is the command, the link comes later."""

from __future__ import annotations

from typing import Literal

from rigs.schema.effect import AT_AXIS, Compensation, Effect, Scope, at_each_axis, size
from rigs.schema.part import Axis
from rigs.schema.scene import S


class ServoLag(Effect):
    """The link follows the feedback late, where the feedback is the command and not the encoder."""

    effect: Literal["servo_lag"] = "servo_lag"
    axis: Axis
    lag_s: float = size(0.2, 5e-4, least=0.0)

    STAGE = "joint"
    PART = "clocks"
    PLACE = AT_AXIS

    def apply(self, scene: S) -> S:
        """The joint stands where it was reported `lag_s` before."""
        axis = self.axis - 1
        return scene.turned(self.axis, (scene.reported_at(scene.t_s - self.lag_s) - scene.q)[:, axis])

    @classmethod
    def forms(cls, scope: Scope) -> list[list[ServoLag]]:
        """One at each joint that turns while it is read."""
        return at_each_axis(cls, scope) if scope.timed else []

    def plain(self, joint: str) -> str:
        return f"lag of {joint} behind its feedback"

    def remedy(self) -> str:
        late_ms = 1e3 * self.lag_s
        return f"axis {self.axis} is {late_ms:.3g} ms late: record encoder angles, not commands, or tune the servo"

    def compensation(self) -> Compensation:
        """A target stands still."""
        return Compensation("none", "shows in motion only: a slower path helps, another target does not")

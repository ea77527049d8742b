from __future__ import annotations

from typing import Literal

from rigs.schema.effect import AT_AXIS, Compensation, Effect, Scope, at_each_axis, size
from rigs.schema.part import Axis
from rigs.schema.scene import S


class ServoLag(Effect):
    """Delay of the link relative to the feedback, if the feedback is the command instead of the encoder."""

    effect: Literal["servo_lag"] = "servo_lag"
    axis: Axis
    lag_s: float = size(0.2, 5e-4, least=0.0)

    STAGE = "joint"
    KIND_NAME = "lag behind the feedback"
    PLAIN = "lag of {joint} behind its feedback"
    CORRECTION = Compensation("none", "occurs only in motion: a slower path helps, a corrected target does not")
    SEAT_NOUN = "axis"
    PART = "clocks"
    PLACE = AT_AXIS

    def apply(self, scene: S) -> S:
        axis = self.axis - 1
        return scene.turned(self.axis, (scene.reported_at(scene.t_s - self.lag_s) - scene.q)[:, axis])

    @classmethod
    def forms(cls, scope: Scope) -> list[list[ServoLag]]:
        return at_each_axis(cls, scope) if scope.timed else []

    def remedy(self) -> str:
        late_ms = 1e3 * self.lag_s
        return f"axis {self.axis} is {late_ms:.3g} ms late: record encoder angles, not commands, or tune the servo"

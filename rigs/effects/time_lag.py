from __future__ import annotations

from typing import Literal

from rigs.schema.effect import OF_THE_CLOCKS, Effect, Scope, size
from rigs.schema.scene import S


class TimeLag(Effect):
    """Delay of the gauge timestamps relative to the feedback."""

    effect: Literal["time_lag"] = "time_lag"
    lag_s: float = size(1, 1e-3)

    STAGE = "time"
    KIND_NAME = "delay of the gauges"
    PLAIN = "time of the gauges against the robot's"
    CORRECTION = OF_THE_CLOCKS
    DEED = "check"

    def apply(self, scene: S) -> S:
        return scene.taken_at(scene.t_s - self.lag_s)

    @classmethod
    def forms(cls, scope: Scope) -> list[list[TimeLag]]:
        return [[cls()]] if scope.timed else []

    def remedy(self) -> str:
        late_ms = 1e3 * self.lag_s
        return f"gauge stamps are {late_ms:+z.3g} ms late: enter the delay of the line, or stamp nearer to the gauge"

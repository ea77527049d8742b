from __future__ import annotations

from typing import Literal

from rigs.schema.effect import OF_THE_CLOCKS, Effect, Scope, size
from rigs.schema.scene import S


class ClockRate(Effect):
    """Relative rate by which the gauge clock is faster than the feedback clock."""

    effect: Literal["clock_rate"] = "clock_rate"
    ppm: float = size(10000, 20)

    STAGE = "time"
    FORM_U = 0.0
    KIND_NAME = "rate of the gauges' clock"
    PLAIN = "rate of the gauges' clock against the robot's"
    REMEDY = "the clocks differ by {e.ppm:+z.3g} ppm: synchronise them"
    CORRECTION = OF_THE_CLOCKS
    DEED = "check"

    def apply(self, scene: S) -> S:
        return scene.taken_at(scene.t_s - 1e-6 * self.ppm * (scene.t_s - scene.t_s[0]))

    @classmethod
    def forms(cls, scope: Scope) -> list[list[ClockRate]]:
        return [[cls()]] if scope.timed else []

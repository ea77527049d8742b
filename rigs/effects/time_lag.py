"""Time lag: gauges with late stamps, read earlier than stamped."""

from __future__ import annotations

from typing import Literal

from rigs.schema.effect import OF_THE_CLOCKS, Compensation, Effect, Scope, size
from rigs.schema.scene import S


class TimeLag(Effect):
    """Delay of the gauges' stamps relative to the feedback's."""

    effect: Literal["time_lag"] = "time_lag"
    lag_s: float = size(1, 1e-3)

    STAGE = "time"
    DEED = "enter"

    def apply(self, scene: S) -> S:
        """Use the state `lag_s` before the stamp."""
        return scene.taken_at(scene.t_s - self.lag_s)

    @classmethod
    def forms(cls, scope: Scope) -> list[list[TimeLag]]:
        """One, if joints turn during the readings."""
        return [[cls()]] if scope.timed else []

    def plain(self, joint: str) -> str:
        return "time of the gauges against the robot's"

    def remedy(self) -> str:
        late_ms = 1e3 * self.lag_s
        return f"gauge stamps are {late_ms:+.3g} ms late: enter the delay of the line, or stamp nearer to the gauge"

    def compensation(self) -> Compensation:
        return OF_THE_CLOCKS

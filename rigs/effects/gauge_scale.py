from __future__ import annotations

from typing import Literal

from rigs.schema.effect import AT_GAUGE, OF_THE_GAUGES, Effect, Gauge, size
from rigs.schema.scene import S


class GaugeScale(Effect):
    """Relative error of the readings of a gauge."""

    effect: Literal["gauge_scale"] = "gauge_scale"
    gauge: Gauge
    relative: float = size(0.2, 5e-4)

    STAGE = "gauge"
    FORM_U = 0.0
    KIND_NAME = "scale"
    CORRECTION = OF_THE_GAUGES
    SEAT_NOUN = "gauge"
    DEED = "check"
    PLACE = AT_GAUGE

    def apply(self, scene: S) -> S:
        return scene.read(self.gauge, lambda g: g * (1 + self.relative))

    def remedy(self) -> str:
        return f"{self.gauge} reads {1e2 * self.relative:+z.3g} %: have it calibrated, or enter the scale"

from __future__ import annotations

from typing import Literal

import numpy as np

from rigs.schema.effect import AT_GAUGE, OF_THE_GAUGES, Effect, Gauge, Scope, at_each_gauge, size
from rigs.schema.scene import S


class GaugeInclination(Effect):
    """Tilt of a gauge, which increases the reading by 1/cos."""

    effect: Literal["gauge_inclination"] = "gauge_inclination"
    gauge: Gauge
    angle_deg: float = size(30, 0.5, least=0.0)

    STAGE = "gauge"
    KIND_NAME = "inclination"
    CORRECTION = OF_THE_GAUGES
    SEAT_NOUN = "gauge"
    DEED = "mount"
    PLACE = AT_GAUGE

    def apply(self, scene: S) -> S:
        return scene.read(self.gauge, lambda g: g / np.cos(np.radians(self.angle_deg)))

    @classmethod
    def forms(cls, scope: Scope) -> list[list[GaugeInclination]]:
        return at_each_gauge(cls, scope)

    def remedy(self) -> str:
        return f"{self.gauge} is tilted by {self.angle_deg:.2f}°: correct the alignment with shims"

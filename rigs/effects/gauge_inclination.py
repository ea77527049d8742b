from __future__ import annotations

from typing import Literal

import numpy as np

from rigs.schema.effect import AT_GAUGE, OF_THE_GAUGES, Effect, Gauge, size
from rigs.schema.scene import S


class GaugeInclination(Effect):
    """Tilt of a gauge, which increases the reading by 1/cos."""

    effect: Literal["gauge_inclination"] = "gauge_inclination"
    gauge: Gauge
    angle_deg: float = size(30, 0.5, least=0.0)

    STAGE = "gauge"
    KIND_NAME = "inclination"
    REMEDY = "{e.gauge} is tilted by {e.angle_deg:.2f}°: correct the alignment with shims"
    CORRECTION = OF_THE_GAUGES
    SEAT_NOUN = "gauge"
    DEED = "mount"
    PLACE = AT_GAUGE

    def apply(self, scene: S) -> S:
        return scene.read(self.gauge, lambda g: g / np.cos(np.radians(self.angle_deg)))

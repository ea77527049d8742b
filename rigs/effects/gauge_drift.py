from __future__ import annotations

from typing import Literal

from rigs.schema.effect import AT_GAUGE, OF_THE_GAUGES, Effect, Gauge, size
from rigs.schema.scene import S


class GaugeDrift(Effect):
    """Drift of a gauge with time."""

    effect: Literal["gauge_drift"] = "gauge_drift"
    gauge: Gauge
    mm_per_min: float = size(1, 2e-4)

    STAGE = "gauge"
    KIND_NAME = "drift"
    CORRECTION = OF_THE_GAUGES
    SEAT_NOUN = "gauge"
    NEEDS_REPEATS = True
    DEED = "wait"
    PLACE = AT_GAUGE

    def apply(self, scene: S) -> S:
        return scene.read(self.gauge, lambda g: g + self.mm_per_min * (scene.t_s - scene.t_s[0]) / 60)

    def remedy(self) -> str:
        return (
            f"{self.gauge} drifts by {1e3 * self.mm_per_min:+z.2g} µm a minute: warm up the gauge, and check the holder"
        )

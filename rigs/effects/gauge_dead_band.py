from __future__ import annotations

from typing import Literal

from rigs.schema.effect import (
    AT_GAUGE,
    OF_THE_GAUGES,
    Departures,
    Effect,
    Gauge,
    size,
)
from rigs.schema.scene import S, play


class GaugeDeadBand(Effect):
    """Motion before a sticking plunger follows."""

    effect: Literal["gauge_dead_band"] = "gauge_dead_band"
    gauge: Gauge
    width_mm: float = size(0.5, 5e-4, least=0.0)

    STAGE = "gauge"
    KIND_NAME = "sticking"
    CORRECTION = OF_THE_GAUGES
    SEAT_NOUN = "gauge"
    NEEDS_REPEATS = True
    DEED = "mount"
    PLACE = AT_GAUGE
    STRAIGHT = 0.0
    FORM_U = 0.2
    """The readings hardly show whether the plunger drags or jumps. Chosen: without it, 40 µm gave 30.0 ± 0.3."""

    def apply(self, scene: S) -> S:
        return scene.read(self.gauge, lambda g: play(g, self.width_mm / 2))

    def remedy(self) -> str:
        width_um = 1e3 * self.width_mm
        return (
            f"the plunger of {self.gauge} sticks by {width_um:.2g} µm: clean and oil the plunger, or replace the gauge"
        )

    def departures(self) -> Departures:
        """Deviation at a target, where the direction of approach of the plunger is unknown."""
        return Departures(stick=(self.gauge, self.width_mm / 2))

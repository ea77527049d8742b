"""Cyclic gauge error: interpolation error within a scale period, a sine of the reading."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from rigs.schema.effect import (
    NUMBER,
    OF_THE_GAUGES,
    Departures,
    Effect,
    Gauge,
    Scope,
    SeatNotation,
    StretchedShape,
    shape,
    size,
)
from rigs.schema.scene import S

_PERIODS_MM = (0.2, 0.5, 1.0, 2.0)
_HARMONIC = 0.15


class GaugeCyclic(Effect):
    """Interpolation error of the scale of a gauge: `amplitude_mm` once per `period_mm`."""

    effect: Literal["gauge_cyclic"] = "gauge_cyclic"
    gauge: Gauge
    period_mm: float = Field(gt=0, le=10)
    amplitude_mm: float = size(0.1, 2e-4, least=0.0)
    phase_deg: float = shape(-360, 360, 0.0)

    STAGE = "gauge"
    KIND_NAME = "interpolation error"
    PLAIN = "interpolation of gauge {e.gauge}, each {e.period_mm:.4g} mm"
    REMEDY = "{e.gauge} has an error every {e.period_mm:g} mm: clean the scale, have the interpolation adjusted"
    CORRECTION = OF_THE_GAUGES
    SEAT_NOUN = "gauge"
    DEED = "mount"
    PLACE = SeatNotation(rf"(?P<gauge>g[12]):(?P<period_mm>{NUMBER})", "g1:0.5 (gauge:period in mm)")
    STRETCHED = (StretchedShape("period_mm", 0.05),)

    def apply(self, scene: S) -> S:
        phase = np.radians(self.phase_deg)
        return scene.read(self.gauge, lambda g: g + self.amplitude_mm * np.sin(2 * np.pi * g / self.period_mm + phase))

    @classmethod
    def forms(cls, scope: Scope) -> list[list[GaugeCyclic]]:
        return [[cls(gauge=gauge, period_mm=period) for period in _PERIODS_MM] for gauge in scope.gauges]

    def departures(self) -> Departures:
        """Deviation of a real scale: a second harmonic, because its two signals are never exactly equal."""
        return Departures(
            tuple(
                (_HARMONIC, self.model_copy(update={"period_mm": self.period_mm / 2, "phase_deg": phase}))
                for phase in (0.0, 90.0)
            )
        )

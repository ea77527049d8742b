from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from rigs.schema.effect import NUMBER, Compensation, Effect, Scope, SeatNotation, shape, size
from rigs.schema.scene import S


class Vibration(Effect):
    """Vibration of the link."""

    effect: Literal["vibration"] = "vibration"
    frequency_hz: float = Field(gt=0, le=500)
    amplitude_mm: float = size(1, 0.002, least=0.0)
    phase_deg: float = shape(-360, 360, 0.0)

    STAGE = "gauge"
    KIND_NAME = "vibration"
    PLAIN = "vibration at {e.frequency_hz:.4g} Hz"
    REMEDY = "the link swings at {e.frequency_hz:.3g} Hz: find what excites it, drive slower, or stiffen the stand"
    CORRECTION = Compensation("none", "is a vibration around the target: only the cause can be removed")
    PART = "gauges"
    PLACE = SeatNotation(rf"(?P<frequency_hz>{NUMBER})", "8.5 (Hz)")

    def apply(self, scene: S) -> S:
        wave = np.sin(2 * np.pi * self.frequency_hz * scene.t_s + np.radians(self.phase_deg))
        return scene.all_read(lambda g: g + self.amplitude_mm * wave[:, None])

    @classmethod
    def forms(cls, scope: Scope) -> list[list[Vibration]]:
        """None, because the phase changes in each run; see `swinging`."""
        return []

    @classmethod
    def swinging(cls, frequency_hz: float, amplitude_mm: float) -> Vibration:
        return cls(frequency_hz=frequency_hz, amplitude_mm=amplitude_mm)

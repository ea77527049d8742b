"""Gauge bow: a scale whose error grows with the square of its reading."""

from __future__ import annotations

from typing import Literal

from rigs.schema.effect import AT_GAUGE, OF_THE_GAUGES, Effect, Gauge, Scope, at_each_gauge, size
from rigs.schema.scene import S


class GaugeBow(Effect):
    """A gauge reads too much by `relative_per_mm` of the square of its reading."""

    effect: Literal["gauge_bow"] = "gauge_bow"
    gauge: Gauge
    relative_per_mm: float = size(0.5, 1e-3)

    STAGE = "gauge"
    KIND_NAME = "bow"
    SEAT_NOUN = "gauge"
    CORRECTION = OF_THE_GAUGES
    PLACE = AT_GAUGE

    def apply(self, scene: S) -> S:
        """g + relative_per_mm · g²."""
        return scene.read(self.gauge, lambda g: g + self.relative_per_mm * g**2)

    @classmethod
    def forms(cls, scope: Scope) -> list[list[GaugeBow]]:
        """One at each gauge."""
        return at_each_gauge(cls, scope)

    def remedy(self) -> str:
        """The middle of the range is hardly affected."""
        return f"{self.gauge} is bent by {self.relative_per_mm:+.2g} per mm: use the middle of its range, or replace it"

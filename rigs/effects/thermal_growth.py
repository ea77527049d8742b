"""Thermal growth: every length of the arm grows alike, so the tool moves away from the base."""

from __future__ import annotations

from typing import Literal

import numpy as np

from rigs.schema.effect import Compensation, Departures, Effect, Scope, StretchedShape, shape, size
from rigs.schema.scene import S

_WARMING_S = (60.0, 300.0, 1200.0)
_SPECTRUM = (0.2, 0.5, 2.0)
"""Time constants, in those of the effect, with which parts of a real arm may grow: motors and gears warm up faster than
castings. Chosen."""
_SHARE = 0.05
"""Standard deviation of the share of each part. Chosen: as for the widths of a play."""


class ThermalGrowth(Effect):
    """Every length grows with run time: by `ppm` in the end, with a time constant."""

    effect: Literal["thermal_growth"] = "thermal_growth"
    ppm: float = size(2000, 20)
    time_constant_s: float = shape(1, 1e5, 600.0)

    STAGE = "tool"
    DEED = "wait"
    PART = "warming"
    STRETCHED = (StretchedShape("time_constant_s", 0.7),)

    def apply(self, scene: S) -> S:
        """ppm (1 - exp(-t / time constant)) of the way from base to tool."""
        growth = self.ppm * 1e-6 * -np.expm1(-np.maximum(scene.t_s, 0) / self.time_constant_s)
        return scene.shifted(growth[:, None] * (scene.T[:, :3, 3] - scene.base_mm))

    @classmethod
    def forms(cls, scope: Scope) -> list[list[ThermalGrowth]]:
        """Quick and slow ones, where gauges are read: poses have no time."""
        return [[cls(time_constant_s=tau) for tau in _WARMING_S]] if scope.gauges else []

    def plain(self, joint: str) -> str:
        return "growth of all lengths with time"

    def remedy(self) -> str:
        return "the arm grows as it warms up: warm it up before measuring, or measure faster"

    def compensation(self) -> Compensation:
        """A target has no time."""
        return Compensation("none", "changes with run time: warming up helps, a fixed target does not")

    def departures(self) -> Departures:
        """Not all of the arm warms up alike: a part of it may be faster or slower."""
        taus_s = [ratio * self.time_constant_s for ratio in _SPECTRUM]
        others = [self.model_copy(update={"time_constant_s": tau_s}) for tau_s in taus_s]
        return Departures(alike=tuple(((_SHARE, part), (-_SHARE, self)) for part in others))

from __future__ import annotations

from typing import Literal

from rigs.schema.effect import (
    WARMING_S,
    Compensation,
    Departures,
    Effect,
    Scope,
    StretchedShape,
    shape,
    size,
    warmed,
    warming_parts,
)
from rigs.schema.part import Axis
from rigs.schema.scene import S

_PARTS = (2, 3, 4, 6)
"""Joints after which a part of the arm may grow separately: upper arm, forearm, wrist and tool."""
_PART_SHARE = 0.3
"""Standard deviation of the additional growth after such a joint, as a share of the total. Chosen."""


class ThermalGrowth(Effect):
    """Growth of every length during the run: finally `ppm`, with a time constant."""

    effect: Literal["thermal_growth"] = "thermal_growth"
    ppm: float = size(2000, 20)
    time_constant_s: float = shape(1, 1e5, 600.0)

    STAGE = "tool"
    KIND_NAME = "thermal growth of the arm"
    PLAIN = "growth of all lengths with time"
    REMEDY = "the arm grows when warming up: warm up the arm before measuring, or measure faster"
    CORRECTION = Compensation("none", "changes with time: warming up helps, a fixed target does not")
    NEEDS_REPEATS = True
    DEED = "wait"
    PART = "warming"
    STRETCHED = (StretchedShape("time_constant_s", 0.7),)

    def apply(self, scene: S) -> S:
        growth = self.ppm * 1e-6 * warmed(scene.t_s, self.time_constant_s)
        return scene.shifted(growth[:, None] * (scene.T[:, :3, 3] - scene.base_mm))

    @classmethod
    def forms(cls, scope: Scope) -> list[list[ThermalGrowth]]:
        """A fast and a slow form for runs with gauges. Poses have no times, so growth is not observable."""
        return [[cls(time_constant_s=tau) for tau in WARMING_S]] if scope.gauges else []

    def departures(self) -> Departures:
        """Deviations of a real arm: its parts grow faster, slower, more or less than the average."""
        keys = {"ppm": self.ppm, "time_constant_s": self.time_constant_s}
        return Departures(
            beside=tuple((_PART_SHARE, _GrowthBeyond(axis=axis, **keys)) for axis in _PARTS), alike=warming_parts(self)
        )


class _GrowthBeyond(ThermalGrowth):
    """Additional growth of the arm after a joint, modelled together with the uniform growth and never named."""

    axis: Axis

    def apply(self, scene: S) -> S:
        growth = self.ppm * 1e-6 * warmed(scene.t_s, self.time_constant_s)
        return scene.shifted(growth[:, None] * (scene.T[:, :3, 3] - scene.link_after(self.axis)[0]))

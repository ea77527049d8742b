"""Link growth: thermal expansion of the bar between tool and ball, or of the gauge holder: both gauges drift alike."""

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
from rigs.schema.scene import S


class LinkGrowth(Effect):
    """Growth of the bar between tool and ball during the run: finally `growth_mm`, with a time constant."""

    effect: Literal["link_growth"] = "link_growth"
    growth_mm: float = size(1, 0.002)
    """Healthy value: 20 ppm, as for the arm, of a bar of 100 mm."""
    time_constant_s: float = shape(1, 1e5, 600.0)

    STAGE = "gauge"
    KIND_NAME = "thermal growth of the ball link"
    PLAIN = "growth of the ball link with time"
    REMEDY = "both gauges drift alike, as the link between tool and ball warms up: let it warm up before measuring"
    CORRECTION = Compensation("none", "is a property of the ball link, which the robot's controller cannot correct")
    NEEDS_REPEATS = True
    DEED = "wait"
    PART = "warming"
    STRETCHED = (StretchedShape("time_constant_s", 0.7),)

    def apply(self, scene: S) -> S:
        growth = self.growth_mm * warmed(scene.t_s, self.time_constant_s)
        return scene.all_read(lambda g: g - growth[:, None])

    @classmethod
    def forms(cls, scope: Scope) -> list[list[LinkGrowth]]:
        return [[cls(time_constant_s=tau) for tau in WARMING_S]] if scope.timed else []

    def departures(self) -> Departures:
        return Departures(alike=warming_parts(self))

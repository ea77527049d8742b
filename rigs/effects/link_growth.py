"""Link growth: the bar between tool and ball, or the holder of the gauges, grows as it warms up.

It moves both gauges alike, and nothing of the arm: two gauges that drift alike are one growth.
"""

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
    """The bar between tool and ball grows with run time: by `growth_mm` in the end, with a time constant."""

    effect: Literal["link_growth"] = "link_growth"
    growth_mm: float = size(1, 0.002)
    """Healthy: 20 ppm, as of the arm, of a bar of 100 mm."""
    time_constant_s: float = shape(1, 1e5, 600.0)

    STAGE = "gauge"
    NEEDS_REPEATS = True
    DEED = "wait"
    PART = "warming"
    STRETCHED = (StretchedShape("time_constant_s", 0.7),)

    def apply(self, scene: S) -> S:
        """growth_mm (1 - exp(-t / time constant)) less between tool and ball, so that every gauge shows less."""
        growth = self.growth_mm * warmed(scene.t_s, self.time_constant_s)
        return scene.all_read(lambda g: g - growth[:, None])

    @classmethod
    def forms(cls, scope: Scope) -> list[list[LinkGrowth]]:
        """Quick and slow ones, where joints turn while gauges are read."""
        return [[cls(time_constant_s=tau) for tau in WARMING_S]] if scope.timed else []

    def plain(self, joint: str) -> str:
        return "growth of the ball link with time"

    def remedy(self) -> str:
        return "both gauges drift alike, as the link between tool and ball warms up: let it warm up before measuring"

    def compensation(self) -> Compensation:
        """It is no part of the robot."""
        return Compensation("none", "belongs to the ball link, which the robot's controller cannot correct")

    def departures(self) -> Departures:
        """Not all of it warms up alike."""
        return Departures(alike=warming_parts(self))

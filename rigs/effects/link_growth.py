"""Link growth: thermal expansion of the bar between tool and ball, or of the gauge holder.

Both gauges change equally while the arm is unaffected: two gauges with equal drift are one growth.
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
    """Growth of the bar between tool and ball with run time: `growth_mm` finally, with a time constant."""

    effect: Literal["link_growth"] = "link_growth"
    growth_mm: float = size(1, 0.002)
    """Healthy value: 20 ppm, as for the arm, of a bar of 100 mm."""
    time_constant_s: float = shape(1, 1e5, 600.0)

    STAGE = "gauge"
    NEEDS_REPEATS = True
    DEED = "wait"
    PART = "warming"
    STRETCHED = (StretchedShape("time_constant_s", 0.7),)

    def apply(self, scene: S) -> S:
        """Reduce the distance between tool and ball by growth_mm (1 - exp(-t / time constant)), so every gauge shows
        less."""
        growth = self.growth_mm * warmed(scene.t_s, self.time_constant_s)
        return scene.all_read(lambda g: g - growth[:, None])

    @classmethod
    def forms(cls, scope: Scope) -> list[list[LinkGrowth]]:
        """Fast and slow, if joints turn during the readings."""
        return [[cls(time_constant_s=tau) for tau in WARMING_S]] if scope.timed else []

    def plain(self, joint: str) -> str:
        return "growth of the ball link with time"

    def remedy(self) -> str:
        return "both gauges drift alike, as the link between tool and ball warms up: let it warm up before measuring"

    def compensation(self) -> Compensation:
        """Not possible, because the link is not a part of the robot."""
        return Compensation("none", "belongs to the ball link, which the robot's controller cannot correct")

    def departures(self) -> Departures:
        """Uneven warming."""
        return Departures(alike=warming_parts(self))

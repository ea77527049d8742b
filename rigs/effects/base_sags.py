"""Sag of the base: the support yields on the side to which the arm leans."""

from __future__ import annotations

from typing import Literal

from rigs.schema.effect import BY_TARGETS, Effect, Scope, SeatNotation, size
from rigs.schema.scene import S

About = Literal["x", "y"]
_WAYS: tuple[About, ...] = ("x", "y")


class BaseSags(Effect):
    """Rise of the base by `mm_per_Nm` of the moment about its x or y axis.

    This describes a support next to the arm, such as a column guide.
    """

    effect: Literal["base_sags"] = "base_sags"
    way: About
    mm_per_Nm: float = size(0.1, 1e-5)
    """Healthy value, derived: tilt of a good base (`base_yields`, 0.09 µrad/Nm) at 100 mm from the support."""

    STAGE = "tool"
    KIND_NAME = "sag of the base under load"
    PLAIN = "sag of the base under load, with the moment about its {e.way}"
    IDLE = "the arm's moment about the base hardly changes, or the masses are missing in the rig file"
    REMEDY = "the base sags under the arm's moment: bolt the base down firmly and stiffen the support"
    CORRECTION = BY_TARGETS
    DEED = "mount"
    PART = "gravity"
    PLACE = SeatNotation("(?P<way>x|y)?", "x", {"way": _WAYS})
    MOST = 400.0

    def apply(self, scene: S) -> S:
        return scene.raised(self.mm_per_Nm * scene.moment()[:, _WAYS.index(self.way)])

    @classmethod
    def forms(cls, scope: Scope) -> list[list[BaseSags]]:
        return [[cls(way=way)] for way in _WAYS]

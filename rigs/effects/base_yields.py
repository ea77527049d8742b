"""Compliant base: the support tilts under the moment of the weight of the arm."""

from __future__ import annotations

import math
from typing import ClassVar, Literal

import numpy as np

from rigs.schema.effect import BY_TARGETS, Effect, FreeShape, Scope, SeatNotation, shape, size
from rigs.schema.scene import S
from rigs.schema.vocabulary import Build

Yields = Literal["evenly", "x", "y", "xy", "yx"]
_WAYS: tuple[Yields, ...] = ("evenly", "x", "y", "xy", "yx")
_ABOUT_DEG: dict[Yields, float] = {"x": 0.0, "xy": 45.0, "y": 90.0, "yx": 135.0}
"""Angle of the tilt axis from the x axis of the base towards y.

With an isotropic compliance, one or two describe any column or frame: the compliance is a symmetric tensor.
"""
_IN_WORDS: dict[Yields, str] = {
    "evenly": "tilt of the base under load, alike in all directions",
    "x": "tilt of the base under load, about its x",
    "y": "tilt of the base under load, about its y",
    "xy": "tilt of the base under load, about the line between its x and y",
    "yx": "tilt of the base under load, about the line between its y and −x",
}
_BELOW_MM = 300.0
"""Depth of the tilt axis below the origin of the base: half of the height for a bending column and the full height for
yielding anchors. Columns and pedestals are 0 to 1000 mm high.
"""


class BaseYields(Effect):
    """Tilt of the base by `deg_per_Nm` of the moment, isotropic (`evenly`) or about a single line.

    below_mm: depth of the tilt axis below the origin of the base.
    """

    effect: Literal["base_yields"] = "base_yields"
    way: Yields
    deg_per_Nm: float = size(0.01, 5e-6, least=0.0)
    """Healthy value, derived: the end of a steel column of 200 × 200 × 10 mm (I = 45.9 · 10⁶ mm⁴, 210 GPa) of 0.8 m
    turns by L / EI = 0.083 µrad/Nm, rounded to 0.09 µrad/Nm.
    """
    below_mm: float = shape(0, 5000, 0.0)

    STAGE = "tool"
    KIND_NAME = "tilt of the base under load"
    USUAL_TIMES: ClassVar[dict[Build, float]] = {"light": 5.0, "torque_sensing": 5.0, "servo": 5.0}
    """A multiple of five for light arms on frames, tables and carts.

    Assumed; no measured support was available.
    """
    IDLE = "the arm's moment about the base hardly changes, or the masses are missing in the rig file"
    CORRECTION = BY_TARGETS
    DEED = "mount"
    PART = "gravity"
    PLACE = SeatNotation("(?P<way>evenly|xy|yx|x|y)?", "evenly", {"way": _WAYS})
    FREE = (FreeShape("below_mm", _BELOW_MM, 300.0),)
    MOST = 400.0
    """Chosen: twice the compliance of a lifting column.

    It tilted by 5 to 9 mrad under an arm of 33 kg, about 15 µrad/Nm.
    """

    def apply(self, scene: S) -> S:
        moment = scene.moment() * [1.0, 1.0, 0.0]
        if self.way != "evenly":
            about = math.radians(_ABOUT_DEG[self.way])
            line = np.array([math.cos(about), math.sin(about), 0.0])
            moment = np.outer(moment @ line, line)
        return scene.tilted(np.radians(self.deg_per_Nm) * moment, self.below_mm)

    @classmethod
    def forms(cls, scope: Scope) -> list[list[BaseYields]]:
        return [[cls(way=way, below_mm=_BELOW_MM)] for way in _WAYS]

    def plain(self, joint: str) -> str:
        return _IN_WORDS[self.way]

    def remedy(self) -> str:
        return (
            f"the base tilts by {1e6 * math.radians(self.deg_per_Nm):.2g} µrad/Nm: bolt the base down "
            "firmly and stiffen its support"
        )

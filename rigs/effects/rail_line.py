from __future__ import annotations

from typing import Literal

import numpy as np

from rigs.schema.effect import BY_TARGETS, Effect, Scope, SeatNotation, size
from rigs.schema.scene import S

Way = Literal["along", "across", "up"]
_WAYS: tuple[Way, ...] = ("along", "across", "up")
_IN_WORDS: dict[Way, str] = {
    "along": "scale of the rail",
    "across": "direction of the rail, sideways",
    "up": "direction of the rail, in height",
}
_REMEDIES: dict[Way, str] = {
    "along": "correct the rail ratio in the controller, or the scale of the encoder",
    "across": "correct the rail direction in the controller and in the rig file",
    "up": "level the rail, or correct the rail direction in the controller and in the rig file",
}


class RailLine(Effect):
    """Displacement of the base by `mm_per_m` per metre of the rail.

    Directions: `along` the rail (scale), `across` it horizontally, or `up`.
    """

    effect: Literal["rail_line"] = "rail_line"
    way: Way
    mm_per_m: float = size(50, 0.05)
    """Healthy value: racks of quality 6 (DIN 3962) are within 0.036 mm per metre.

    Levels and lasers align with similar accuracy.
    """

    STAGE = "tool"
    KIND_NAME = "straightness of the rail"
    CORRECTION = BY_TARGETS
    DEED = "mount"
    PART = "constants"
    PLACE = SeatNotation("(?P<way>along|across|up)?", "along", {"way": _WAYS})

    def apply(self, scene: S) -> S:
        return scene.along_rail(self.mm_per_m * np.eye(3)[_WAYS.index(self.way)])

    @classmethod
    def forms(cls, scope: Scope) -> list[list[RailLine]]:
        return [[cls(way=way)] for way in _WAYS] if scope.rail else []

    def plain(self, joint: str) -> str:
        return _IN_WORDS[self.way]

    def remedy(self) -> str:
        return f"the arm is displaced by {self.mm_per_m:+z.4f} mm per metre of the rail: {_REMEDIES[self.way]}"

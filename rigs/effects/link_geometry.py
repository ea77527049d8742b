from __future__ import annotations

from typing import Literal

import numpy as np

from rigs.schema.effect import EVERY_AXIS, Compensation, Effect, Scope, SeatNotation, size
from rigs.schema.part import Axis
from rigs.schema.reference import Reference
from rigs.schema.scene import S

Constant = Literal["a", "alpha", "d", "beta"]
_CONSTANTS: tuple[Constant, ...] = ("a", "alpha", "d", "beta")
_IN_WORDS: dict[Constant, str] = {"a": "length a", "d": "offset d", "alpha": "twist alpha", "beta": "twist beta"}
_KEYS: dict[Constant, str] = {"a": "a_mm", "alpha": "alpha_deg", "beta": "beta_deg", "d": "d_mm"}
_PARALLEL = 1e-3
"""Sine of the angle between two axes below which they count as parallel."""


class LinkGeometry(Effect):
    """Wrong link constant: `field` of `axis` is larger than in the rig file by `delta` (mm or degrees)."""

    effect: Literal["link_geometry"] = "link_geometry"
    axis: Axis
    field: Constant
    delta: float = size(50, 0.2)

    STAGE = "arm"
    FORM_U = 0.0
    SEAT_NOUN = "axis"
    DEED = "enter"
    WEARS = False
    STRAIGHT = 0.02  # beyond this share of a healthy size the non-linearity would be visible
    # The angle beta of Hayati is an addition to the four parameters of a joint.
    PLACE = SeatNotation(
        r"(?:(?P<axis>[1-7])(?:\.(?P<field>a|alpha|d|beta))?)?",
        "3.a",
        {"axis": EVERY_AXIS, "field": ("a", "alpha", "d")},
    )

    def apply(self, scene: S) -> S:
        return scene.with_constant(self.field, self.axis, self.delta if self._length else np.radians(self.delta))

    @classmethod
    def forms(cls, scope: Scope) -> list[list[LinkGeometry]]:
        return [
            [cls(axis=axis, field=field)]
            for axis in scope.axes
            for field in _CONSTANTS
            # The angle of Hayati applies to a joint parallel to the previous joint; otherwise it is redundant.
            if field != "beta" or (axis > 1 and abs(np.sin(np.radians(scope.twist_deg[axis - 1]))) < _PARALLEL)
        ]

    @classmethod
    def kind_name(cls, field: str) -> str:
        return next((name for constant, name in _IN_WORDS.items() if constant == field), "")

    def plain(self, joint: str) -> str:
        return f"{_IN_WORDS[self.field]} of {joint} in the rig file"

    def remedy(self) -> str:
        return (
            f"add {self.delta:+z.4f} {'mm' if self._length else '°'} to {self.field} of axis {self.axis} in the rig "
            f"file ({self.symbol} in the robot's constants)"
        )

    def compensation(self) -> Compensation:
        return Compensation("link constant", constant=(self.axis, _KEYS[self.field]))

    def usual_times(self, reference: Reference) -> float:
        """Typical deviation of this constant in arms of the family (rigs/families/sizes.yaml)."""
        return reference.link_sizes.get(self.seat, self.healthy) / self.healthy

    @property
    def healthy(self) -> float:
        return 0.2 if self._length else 0.02

    @property
    def seat(self) -> str:
        return f"{self.axis}.{self.field}"

    @classmethod
    def changing(cls, axis: int, key: str, delta: float) -> LinkGeometry:
        unchanged = cls.model_validate({"axis": axis, "field": key.rsplit("_", 1)[0]})
        return unchanged.model_copy(update={"delta": delta})

    @property
    def symbol(self) -> str:
        return f"{self.field}{self.axis if self.field == 'd' else self.axis - 1}"

    def unit(self, parameter: str) -> str:
        return "mm" if self._length else "deg"

    @property
    def _length(self) -> bool:
        return self.field in ("a", "d")

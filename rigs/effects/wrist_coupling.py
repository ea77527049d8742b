from __future__ import annotations

from typing import Literal

from rigs.schema.effect import BY_TARGETS, Effect, Scope, SeatNotation, size
from rigs.schema.part import Axis
from rigs.schema.scene import S

_WRIST = ((-3, -2), (-3, -1), (-2, -1))
"""Pairs of the last three axes, counted from the last."""


class WristCoupling(Effect):
    """Rotation of a wrist axis caused by another wrist axis: link[to] gains `ratio` times q[from]."""

    effect: Literal["wrist_coupling"] = "wrist_coupling"
    from_axis: Axis
    to_axis: Axis
    ratio: float = size(0.1, 1e-4)

    STAGE = "joint"
    KIND_NAME = "coupling between wrist axes"
    PLAIN = "axis {e.from_axis} leaking into axis {e.to_axis}"
    REMEDY = "motion of axis {e.from_axis} leaks into axis {e.to_axis}: correct the wrist's coupling ratio"
    CORRECTION = BY_TARGETS
    DEED = "check"
    PART = "constants"
    PLACE = SeatNotation(r"(?P<from_axis>[1-7])\.(?P<to_axis>[1-7])", "4.5 (from.to)")

    def apply(self, scene: S) -> S:
        return scene.turned(self.to_axis, self.ratio * scene.q[:, self.from_axis - 1])

    @classmethod
    def forms(cls, scope: Scope) -> list[list[WristCoupling]]:
        return [[cls(from_axis=scope.axes[start], to_axis=scope.axes[end])] for start, end in _WRIST]

    @property
    def seat(self) -> str:
        return f"{self.from_axis}>{self.to_axis}"

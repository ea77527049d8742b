from __future__ import annotations

from typing import Literal

import numpy as np

from rigs.schema.effect import AT_AXIS, BY_TARGETS, Effect, size
from rigs.schema.part import Axis
from rigs.schema.scene import S

_NOTHING_MM = 1e-6
"""Lever arm perpendicular to the axis below which a link cannot bend."""


class LinkBending(Effect):
    """Bending of the link after `axis` under gravity: the end moves by `mm_per_Nm` times the torque."""

    effect: Literal["link_bending"] = "link_bending"
    axis: Axis
    mm_per_Nm: float = size(0.05, 1e-4, least=0.0)

    STAGE = "tool"
    KIND_NAME = "bending"
    PLAIN = "bending of the link after {joint}"
    IDLE = "gravity does not bend the link after axis {e.axis}"
    REMEDY = "the link after axis {e.axis} bends: enter the actual payload; check flange and bolts"
    CORRECTION = BY_TARGETS
    SEAT_NOUN = "link"
    DEED = "enter"
    PLACE = AT_AXIS

    def apply(self, scene: S) -> S:
        """Move all parts after the link across it, in the plane of the torque. Their orientation is unchanged."""
        joint, z, end = scene.link_after(self.axis)
        across = np.cross(z, end - joint)
        length = np.linalg.norm(across, axis=1, keepdims=True)
        across = np.divide(across, length, out=np.zeros_like(across), where=length > _NOTHING_MM)
        torque = scene.torques()[:, self.axis - 1]
        return scene.shifted((self.mm_per_Nm * torque)[:, None] * across)

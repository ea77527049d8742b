"""Wrist coupling: the motion of one wrist axis leaks into another through their common gears."""

from __future__ import annotations

from analysis.model.scene import Scene
from rigs.effects import WristCoupling

STAGE = "joint"


def apply(effect: WristCoupling, scene: Scene) -> Scene:
    """The driven axis gains a share of the driving one's angle."""
    return scene.turned(effect.to_axis, effect.ratio * scene.q[:, effect.from_axis - 1])

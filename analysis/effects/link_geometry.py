"""Link geometry: a constant of the arm is not what the rig file says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.model.scene import Scene
from rigs.effects import LinkGeometry

STAGE = "arm"


def apply(effect: LinkGeometry, scene: Scene) -> Scene:
    """The arm with that constant changed."""
    column = getattr(scene.arm, effect.field).copy()
    column[effect.axis - 1] += effect.delta if effect.field in ("a", "d") else np.radians(effect.delta)
    return replace(scene, arm=replace(scene.arm, **{effect.field: column}))

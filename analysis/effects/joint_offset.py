"""Joint zero offset: the paper's datum location error. Link side = reported + offset."""

from __future__ import annotations

import numpy as np

from analysis.model.scene import Scene
from rigs.effects import JointOffset

STAGE = "joint"


def apply(effect: JointOffset, scene: Scene) -> Scene:
    """The joint stands off by a constant."""
    return scene.turned(effect.axis, np.radians(effect.offset_deg))

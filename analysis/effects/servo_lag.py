"""Servo lag: where the feedback is the command, the link comes later."""

from __future__ import annotations

import numpy as np

from analysis.model.scene import Scene
from rigs.effects import ServoLag

STAGE = "joint"


def apply(effect: ServoLag, scene: Scene) -> Scene:
    """The joint stands where it was reported `lag_s` before."""
    q = scene.q[:, effect.axis - 1]
    return scene.turned(effect.axis, np.interp(scene.t_s - effect.lag_s, scene.t_s, q) - q)

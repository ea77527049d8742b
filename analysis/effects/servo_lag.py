"""Servo lag: where the feedback is the command, the link comes later."""

from __future__ import annotations

from analysis.model.scene import Scene
from rigs.effects import ServoLag

STAGE = "joint"


def apply(effect: ServoLag, scene: Scene) -> Scene:
    """The joint stands where it was reported `lag_s` before."""
    axis = effect.axis - 1
    return scene.turned(effect.axis, (scene.reported_at(scene.t_s - effect.lag_s) - scene.q)[:, axis])

"""Time lag: gauges stamped late were read earlier than their stamps say."""

from __future__ import annotations

from analysis.model.scene import Scene
from rigs.effects import TimeLag

STAGE = "time"


def apply(effect: TimeLag, scene: Scene) -> Scene:
    """Everything is as it was `lag_s` before the stamp."""
    return scene.taken_at(scene.t_s - effect.lag_s)

"""Clock rate: the gauges' clock runs fast against the feedback's, so its stamps run ahead."""

from __future__ import annotations

from analysis.model.scene import Scene
from rigs.effects import ClockRate

STAGE = "time"


def apply(effect: ClockRate, scene: Scene) -> Scene:
    """A stamp t stands for t - ppm t, counted from the run's begin."""
    return scene.taken_at(scene.t_s - 1e-6 * effect.ppm * (scene.t_s - scene.t_s[0]))

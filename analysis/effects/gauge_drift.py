"""Gauge drift: a reading that moves with time."""

from __future__ import annotations

from analysis.model.scene import Scene
from rigs.effects import GaugeDrift

STAGE = "gauge"


def apply(effect: GaugeDrift, scene: Scene) -> Scene:
    """Linear from the run's begin."""
    return scene.read(effect.gauge, lambda g: g + effect.mm_per_min * (scene.t_s - scene.t_s[0]) / 60)

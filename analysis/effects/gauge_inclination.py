"""Gauge inclination: a gauge that stands askew measures along its own axis, the cosine error."""

from __future__ import annotations

import numpy as np

from analysis.model.scene import Scene
from rigs.effects import GaugeInclination

STAGE = "gauge"


def apply(effect: GaugeInclination, scene: Scene) -> Scene:
    """g / cos(angle)."""
    return scene.read(effect.gauge, lambda g: g / np.cos(np.radians(effect.angle_deg)))

"""Gauge scale: a gauge reads too much by a share of its reading."""

from __future__ import annotations

from analysis.model.scene import Scene
from rigs.effects import GaugeScale

STAGE = "gauge"


def apply(effect: GaugeScale, scene: Scene) -> Scene:
    """g (1 + relative)."""
    return scene.read(effect.gauge, lambda g: g * (1 + effect.relative))

"""Gauge baseline: the gauges stand further apart than the rig file says, evenly about their middle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.model.scene import Scene
from rigs.effects import GaugeBaseline

STAGE = "setup"


def apply(effect: GaugeBaseline, scene: Scene) -> Scene:
    """Each gauge moves out by half; one gauge alone has no baseline."""
    if len(scene.offsets_mm) < 2:
        return scene
    middle = scene.offsets_mm.mean()
    return replace(scene, offsets_mm=scene.offsets_mm + np.sign(scene.offsets_mm - middle) * effect.delta_mm / 2)

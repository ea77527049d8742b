"""Vibration: the link swings, and all gauges with it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.model.scene import Scene
from rigs.effects import Vibration

STAGE = "gauge"


def apply(effect: Vibration, scene: Scene) -> Scene:
    """A sin(2 pi f t + phase) on every reading."""
    swing = np.sin(2 * np.pi * effect.frequency_hz * scene.t_s + np.radians(effect.phase_deg))
    return replace(scene, g_mm=scene.g_mm + effect.amplitude_mm * swing[:, None])

"""Cyclic gauge error: the interpolation of a scale's period, a sine of the reading itself."""

from __future__ import annotations

import numpy as np

from analysis.model.scene import Scene
from rigs.effects import GaugeCyclic

STAGE = "gauge"


def apply(effect: GaugeCyclic, scene: Scene) -> Scene:
    """A sin(2 pi g / period + phase)."""
    phase = np.radians(effect.phase_deg)
    wave = effect.amplitude_mm
    return scene.read(effect.gauge, lambda g: g + wave * np.sin(2 * np.pi * g / effect.period_mm + phase))

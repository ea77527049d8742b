"""Ball form: lobes around the ball, met at the angle at which the link touches it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.model.scene import Scene
from rigs.effects import BallForm

STAGE = "setup"


def apply(effect: BallForm, scene: Scene) -> Scene:
    """Where the ball stands proud the distance reads longer."""
    wave = np.sin(effect.lobes * scene.contact + np.radians(effect.phase_deg))
    return replace(scene, form_mm=scene.form_mm + effect.amplitude_mm * wave)

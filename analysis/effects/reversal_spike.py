"""Wind-up at reversal: after each turn the link hangs back against the new direction, and relaxes."""

from __future__ import annotations

import numpy as np

from analysis.model.hysteresis import turns
from analysis.model.scene import Scene
from rigs.effects import ReversalSpike

STAGE = "joint"


def apply(effect: ReversalSpike, scene: Scene) -> Scene:
    """A spike at each reversal, exp(-t / decay)."""
    deviation = np.zeros(len(scene.t_s))
    for when, direction in turns(scene.t_s, scene.q[:, effect.axis - 1]):
        since = scene.t_s - when
        deviation -= direction * np.where(since >= 0, np.exp(-np.maximum(since, 0) / effect.decay_s), 0.0)
    return scene.turned(effect.axis, np.radians(effect.amplitude_deg) * deviation)

"""Wind-up at reversal: after each turn the link hangs back against the new direction, and relaxes."""

from __future__ import annotations

import numpy as np

from analysis.model.hysteresis import turns
from analysis.model.scene import Scene
from rigs.effects import ReversalSpike

STAGE = "joint"
_SLOWER = 4.0


def apply(effect: ReversalSpike, scene: Scene) -> Scene:
    """A spike at each reversal, exp(-t / decay), in part four times as slow, once it has risen."""
    deviation = np.zeros(len(scene.t_s))
    for when, direction in turns(scene.t_s, scene.q[:, effect.axis - 1]):
        since = np.maximum(scene.t_s - when, 0.0) / effect.decay_s
        relaxing = (1 - effect.slow) * np.exp(-since) + effect.slow * np.exp(-since / _SLOWER)
        if effect.rise:
            relaxing *= -np.expm1(-since / effect.rise)
        deviation -= direction * np.where(scene.t_s >= when, relaxing, 0.0)
    return scene.turned(effect.axis, np.radians(effect.amplitude_deg) * deviation)

"""Transmission error: a gear that runs ahead and behind with the angle of the joint, A sin(N q + phase)."""

from __future__ import annotations

import numpy as np

from analysis.model.scene import Scene
from rigs.effects import TransmissionError

STAGE = "joint"


def apply(effect: TransmissionError, scene: Scene) -> Scene:
    """N = 1 is an eccentric wheel; the gear ratio, twice the wave generator, the tooth mesh are others."""
    turn = effect.order * scene.q[:, effect.axis - 1] + np.radians(effect.phase_deg)
    shape = np.sin(turn) + effect.third * np.sin(3 * turn)
    return scene.turned(effect.axis, np.radians(effect.amplitude_deg) * shape)

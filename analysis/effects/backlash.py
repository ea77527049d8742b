"""Backlash: the link lags behind in a play, -w/2 while q rises, +w/2 while it falls.

`transit` spreads the crossing, as several plays of different width side by side would (Prandtl and Ishlinskii).
`preload` is the share of the play in which gravity, and not friction, holds a flank: there the link lies where the
torque presses it, and no reversal shows.
"""

from __future__ import annotations

import numpy as np

from analysis.model.gravity import torques
from analysis.model.hysteresis import play
from analysis.model.scene import Scene
from rigs.effects import Backlash

STAGE = "joint"
_SPREAD = np.linspace(-0.9, 0.9, 7)
_FIRM_NM = 1.0
"""A torque of this size presses the flank firmly; below, it gives way smoothly."""


def apply(effect: Backlash, scene: Scene) -> Scene:
    """The joint lags; the trace begins in the middle of the play."""
    half = np.radians(effect.width_deg) / 2
    q = scene.q[:, effect.axis - 1]
    widths = half * (1 + effect.transit * _SPREAD) if effect.transit else np.array([half])
    deviation = np.mean([play(q, width) for width in widths], axis=0) - q
    if effect.preload:
        pressed = half * np.tanh(torques(scene.arm, scene.load, scene.q)[:, effect.axis - 1] / _FIRM_NM)
        deviation = (1 - effect.preload) * deviation + effect.preload * pressed
    return scene.turned(effect.axis, deviation)

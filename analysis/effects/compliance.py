"""Joint compliance: the gear twists under the torque of gravity, links and payload."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.model.gravity import torques
from analysis.model.scene import Scene
from rigs.effects import Compliance

STAGE = "joint"


def apply(effect: Compliance, scene: Scene) -> Scene:
    """The joint gives way in the direction in which gravity pulls it."""
    load = replace(scene.load, payload_kg=scene.load.payload_kg + effect.payload_kg)
    torque = torques(scene.arm, load, scene.q)[:, effect.axis - 1]
    return scene.turned(effect.axis, np.radians(effect.deg_per_Nm) * torque)

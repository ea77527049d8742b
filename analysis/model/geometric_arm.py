"""The geometric part of a model: the arm whose constants the effects of a rig file have changed.

Joint zeros and link constants are the same in all postures, so that an arm with other constants carries them whole, in
any program that knows rigid arms. Compliance, waves, plays, growth and lag are not in it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.kinematics.arm import Arm
from analysis.model.hysteresis import Motion
from analysis.model.predict import Model, Path, driven
from rigs.effects import Effect

_GEOMETRIC = ("joint zero", "link constant")
"""The uses of what is a constant of the arm."""


def is_geometric(effect: Effect) -> bool:
    """Return whether an effect only changes constants of the arm."""
    return effect.compensation().use in _GEOMETRIC


def geometric_part(model: Model) -> Model:
    """Return the model without the effects that constants of the arm cannot carry."""
    return replace(model, effects=tuple(effect for effect in model.effects if is_geometric(effect)))


def geometric_arm(model: Model) -> Arm:
    """Return the arm with all joint zeros and link constants of a model's effects in its own constants.

    Reported angles give the same poses with it as with the geometric part of the model.
    """
    at_zero = Path(Motion(np.zeros(1), np.zeros((1, model.arm.axes))), np.zeros(1, dtype=np.int64), stands=True)
    scene = driven(geometric_part(model), at_zero)
    turned = scene.arm.coupling @ scene.link_q[0]
    return replace(scene.arm, offset=scene.arm.offset + turned)

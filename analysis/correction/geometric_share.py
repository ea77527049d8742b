"""How much of a model a rigid arm carries: over the work of a rig, in micrometres at the tool."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from analysis.correction.work import apart_mm, work_angles
from analysis.kinematics.arm import Array
from analysis.model.predict import Model, geometric_part, is_geometric
from rigs.effects import Effect
from rigs.schema.scene import Stage

_OF_THE_ARM: tuple[Stage, ...] = ("arm", "joint", "tool")
"""The stages whose effects move the tool; the others are of clocks, the ball and the gauges."""


@dataclass(frozen=True)
class GeometricShare:
    """What effects move the tool by over the work, root mean square in µm: all of them, and what is left when the arm
    has the constants. left_out: the effects that no constants carry."""

    all_um: float
    left_um: float
    left_out: tuple[Effect, ...]


def geometric_share(model: Model) -> GeometricShare:
    """Return how much of a model's displacement of the tool the constants of an arm do not carry."""
    whole = replace(model, effects=tuple(effect for effect in model.effects if effect.STAGE in _OF_THE_ARM))
    q = work_angles(model.rig)
    return GeometricShare(
        _rms_um(apart_mm(whole, replace(model, effects=()), q)),
        _rms_um(apart_mm(whole, geometric_part(whole), q)),
        tuple(effect for effect in whole.effects if not is_geometric(effect)),
    )


def _rms_um(distance_mm: Array) -> float:
    return 1000.0 * float(np.sqrt(np.mean(distance_mm**2)))

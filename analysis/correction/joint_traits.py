"""What a model and runs say of each joint beyond its geometry, for a simulator: play, compliance, friction."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence

from analysis.arms.mjcf_text import JointTraits
from analysis.correction.plays import known_plays
from analysis.traces.friction import Friction
from rigs.effects import Effect
from rigs.errors import UseError
from rigs.rig import Rig
from rigs.schema.effect import AT_AXIS, is_play, size_field

_OPTION = "--nm-per-a"
_SPRING = "deg_per_Nm"
"""The size of an effect that turns a joint in proportion to its torque, as a spring does."""


def joint_traits(rig: Rig, friction_nm: Mapping[int, float] | None = None) -> JointTraits:
    """Return the plays that are known well enough and the compliances of a rig's model, named and calibrated.

    friction_nm: Coulomb friction of joints in Nm, by axis from 1. Terms of one axis add up; a sum that is not above
    zero is no compliance of a joint and is left out.
    """
    play_deg, soft = defaultdict[int, float](float), defaultdict[int, float](float)
    for effect in known_plays(rig):
        if effect.PLACE == AT_AXIS and is_play(effect):
            play_deg[_axis(effect)] += float(getattr(effect, size_field(effect)))
    terms = [(effect, 1.0) for effect in rig.effects]
    terms += [(term.effect, term.times) for term in rig.calibrated.terms if not term.named] if rig.calibrated else []
    for effect, times in terms:
        if effect.PLACE == AT_AXIS and size_field(effect) == _SPRING:
            soft[_axis(effect)] += times * float(getattr(effect, size_field(effect)))
    return JointTraits(dict(play_deg), {axis: value for axis, value in soft.items() if value > 0}, friction_nm or {})


def friction_nm(friction: Mapping[int, Friction], nm_per_a: Sequence[float]) -> dict[int, float]:
    """Return the friction of joints in Nm, by axis from 1, from the current that it takes and the torque for each
    ampere. Raises UseError where an axis has no constant."""
    if friction and max(friction) > len(nm_per_a):
        problem = f"has {len(nm_per_a)} numbers, and the run shows the friction of axis {max(friction)}"
        raise UseError(_OPTION, problem, "give one number for each axis, from the maker's data sheet")
    return {axis: joint.current_a * nm_per_a[axis - 1] for axis, joint in sorted(friction.items())}


def torques_of(text: str) -> tuple[float, ...]:
    """Return the torque of each axis for one ampere, in Nm, from a list with commas. Raises UseError."""
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if not values or not all(math.isfinite(value) and value > 0 for value in values):
        raise UseError(_OPTION, f"{text!r} is not a list of torques above zero", "give one an axis, with commas")
    return values


def _axis(effect: Effect) -> int:
    return int(getattr(effect, "axis", 0))

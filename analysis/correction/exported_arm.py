"""What of a rig's model the arm that other programs read carries: its geometry, and for a simulator what model and runs
say of each joint beyond it: play, compliance, friction.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from analysis.correction.plays import known_plays
from analysis.correction.work import apart_mm, rms_um, work_angles
from analysis.robot.description.mjcf_text import JointTraits, mjcf_text
from analysis.robot.kinematics.arm import Arm
from analysis.robot.model.predict import Model, geometric_part, is_geometric
from analysis.runs.robot_condition import Friction
from rigs.effects import Effect
from rigs.errors import UseError
from rigs.rig import Rig
from rigs.schema.effect import AT_AXIS, is_play, size_field
from rigs.schema.scene import Stage

_MOST_LISTED = 4
"""Effects that one line lists; of more it gives the number."""
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


_OF_THE_ARM: tuple[Stage, ...] = ("arm", "joint", "tool")
"""The stages whose effects move the tool; the others are of clocks, the ball and the gauges."""


@dataclass(frozen=True)
class GeometricShare:
    """What effects move the tool by over the work, root mean square in µm: all of them, and what is left when the arm
    has the constants. left_out: the effects that no constants carry."""

    all_um: float
    left_um: float
    left_out: tuple[Effect, ...]

    @property
    def words(self) -> str:
        """What a file of the geometry has of the model, as a sentence."""
        if self.all_um == 0:
            return "The rig file has no effect that moves the tool: this is the arm as its constants say."
        moved = f"in the robot's base its effects move the tool by {self.all_um:.1f} µm rms over the work"
        if not self.left_out:
            return f"All of the model is geometry and is in this file: {moved}."
        names = [f"{effect.effect} {effect.seat}".strip() for effect in self.left_out]
        ending = f" and {len(names) - _MOST_LISTED} more" if len(names) > _MOST_LISTED else ""
        listed = ", ".join(names[:_MOST_LISTED]) + ending
        return f"Only the geometry is in this file: {moved}; {self.left_um:.1f} µm rms of it are left out ({listed})."


def geometric_share(model: Model) -> GeometricShare:
    """Return how much of a model's displacement of the tool the constants of an arm do not carry."""
    whole = replace(model, effects=tuple(effect for effect in model.effects if effect.STAGE in _OF_THE_ARM))
    q = work_angles(model.rig)
    return GeometricShare(
        rms_um(apart_mm(whole, replace(model, effects=()), q)),
        rms_um(apart_mm(whole, geometric_part(whole), q)),
        tuple(effect for effect in whole.effects if not is_geometric(effect)),
    )


def simulated_arm(rig: Rig, arm: Arm, where: str, carried: str, friction: Mapping[int, float]) -> tuple[str, str]:
    """Return an arm as a model of MuJoCo with what the model of its rig says of the joints, and what it holds of that
    model, as sentences, `carried` the first.

    where: the rig file, for errors. friction: of the joints in Nm, by axis from 1. Raises as `mjcf_text` does.
    """
    traits = joint_traits(rig, friction)
    parts = [
        f"{cause} of axis {', '.join(map(str, sorted(axes)))}"
        for cause, axes in (
            ("play", traits.play_deg),
            ("deflection under load", traits.compliance_deg_per_nm),
            ("friction", traits.friction_nm),
        )
        if axes
    ]
    hinges = f"In hinges beside the joints' own: {'; '.join(parts)}."
    of_joints = hinges if parts else "Neither play nor deflection under load was found."
    return mjcf_text(rig.robot, arm, traits, where, [carried, of_joints]), f"{carried} {of_joints}"

"""Parts of a rig's model in exported arms: geometry; for simulators also play, compliance and friction of joints."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from analysis.apps.interchange.mjcf_text import JointTraits, mjcf_text
from analysis.apps.report.diagnosis_words import plain_name
from analysis.correction.support import known_plays
from analysis.correction.work import apart_mm, rms_um, work_angles
from analysis.robot.kinematics.arm import Arm
from analysis.robot.predict import Model, geometric_part, is_geometric
from analysis.runs.robot_condition import Friction
from rigs.effects import Effect
from rigs.errors import UseError
from rigs.rig import Rig
from rigs.schema.effect import AT_AXIS, is_play, size_field
from rigs.schema.scene import Stage
from rigs.text import first_of, numbers_in

_MOST_LISTED = 4
_OPTION = "--nm-per-a"
_SPRING = "deg_per_Nm"
"""Size parameter of effects that turn a joint in proportion to its torque, like a spring."""


def joint_traits(rig: Rig, friction_nm: Mapping[int, float] | None = None) -> JointTraits:
    """Known backlash and compliance of a rig's model, named and calibrated.

    friction_nm: Coulomb friction of joints in Nm, by axis from 1. Terms of the same axis add up; a sum that is not
    positive is not a compliance and is dropped.
    """
    terms = [(effect, 1.0) for effect in rig.effects]
    terms += [(term.effect, term.times) for term in rig.calibrated.terms if not term.named] if rig.calibrated else []
    play_deg = _sums((effect, 1.0) for effect in known_plays(rig) if is_play(effect))
    soft = _sums(term for term in terms if size_field(term[0]) == _SPRING)
    return JointTraits(play_deg, {axis: value for axis, value in soft.items() if value > 0}, friction_nm or {})


def friction_nm(friction: Mapping[int, Friction], nm_per_a: Sequence[float]) -> dict[int, float]:
    """Joint friction in Nm, by axis from 1, from motor current and torque constant.

    Raises UseError if an axis has no constant.
    """
    if friction and max(friction) > len(nm_per_a):
        problem = f"has {len(nm_per_a)} numbers, but the run shows the friction of axis {max(friction)}"
        raise UseError(_OPTION, problem, "give a number for each axis, from the data sheet", code="output.invalid")
    return {axis: joint.current_a * nm_per_a[axis - 1] for axis, joint in sorted(friction.items())}


def torques_of(text: str) -> tuple[float, ...]:
    """Parse the torque of each axis per ampere, in Nm, from a comma-separated list. Raises UseError."""
    values = numbers_in(text)
    if not values or min(values) <= 0:
        problem, remedy = f"{text!r} is not a list of torques above zero", "give a number per axis, separated by commas"
        raise UseError(_OPTION, problem, remedy, code="output.invalid")
    return values


def _sums(terms: Iterable[tuple[Effect, float]]) -> dict[int, float]:
    """Sum of the sizes of effects at each axis, each with a factor."""
    sums = defaultdict[int, float](float)
    for effect, times in terms:
        if effect.PLACE == AT_AXIS:
            sums[int(getattr(effect, "axis", 0))] += times * float(getattr(effect, size_field(effect)))
    return dict(sums)


_OF_THE_ARM: tuple[Stage, ...] = ("arm", "joint", "tool")
"""Stages with an influence on the tool; the other stages concern clocks, ball and gauges."""


@dataclass(frozen=True)
class GeometricShare:
    """Rms tool displacement over the work area, in µm."""

    all_um: float
    left_um: float
    """Remaining with the arm's constants."""
    left_out: tuple[Effect, ...]
    """Effects that constants cannot represent."""
    rig: Rig

    @property
    def words(self) -> str:
        if self.all_um == 0:
            return "The rig file has no effect that moves the tool: this is the nominal arm."
        moved = f"in the base frame the effects move the tool by {self.all_um:.1f} µm rms over the work area"
        if self.rig.calibrated:
            moved += f" ({self.rig.calibrated.before_um:.0f} µm rms in the readings of the diagnosis)"
        if not self.left_out:
            return f"All of the model is geometry and is in this file: {moved}."
        names = list(dict.fromkeys(plain_name(self.rig, effect) for effect in self.left_out))
        listed = first_of(names, _MOST_LISTED, "; ")
        return f"Only the geometry is in this file: {moved}; {self.left_um:.1f} µm rms of it are ignored ({listed})."


def geometric_share(model: Model) -> GeometricShare:
    """Compare a model's tool displacement with the part that arm constants represent."""
    whole = replace(model, effects=tuple(effect for effect in model.effects if effect.STAGE in _OF_THE_ARM))
    q = work_angles(model.rig)
    return GeometricShare(
        rms_um(apart_mm(whole, replace(model, effects=()), q)),
        rms_um(apart_mm(whole, geometric_part(whole), q)),
        tuple(effect for effect in whole.effects if not is_geometric(effect)),
        model.rig,
    )


def simulated_arm(rig: Rig, arm: Arm, where: str, carried: str, friction: Mapping[int, float]) -> tuple[str, str]:
    """Write an arm as a MuJoCo model with the joint properties; the description starts with `carried`.

    friction: of the joints in Nm, by axis from 1. Raises the errors of `mjcf_text`.
    """
    traits = joint_traits(rig, friction)
    soft = traits.compliance_deg_per_nm
    of_cause = {"play": traits.play_deg, "deflection under load": soft, "friction": traits.friction_nm}
    parts = [f"{cause} of axis {', '.join(map(str, sorted(axes)))}" for cause, axes in of_cause.items() if axes]
    hinges = f"In additional hinges: {'; '.join(parts)}."
    of_joints = hinges if parts else "Neither play nor deflection under load was found."
    return mjcf_text(rig.robot, arm, traits, where, [carried, of_joints]), f"{carried} {of_joints}"

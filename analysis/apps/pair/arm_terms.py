"""Unknown errors of one arm of a pair: effects of the library at one prior standard deviation each."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from analysis.robot.kinematics.arm import Array
from analysis.robot.predict import Model, load_of, model_of, moved, visits
from rigs.calibration import effects_of, is_sine, sine_of
from rigs.effects import VOCABULARY, Effect
from rigs.rig import Rig
from rigs.schema.effect import Scope, healthy, phases, scaled, size_field

Group = Literal["constants", "gravity", "curves"]
GROUPS: tuple[Group, ...] = ("constants", "gravity", "curves")
_ORDERS = (1, 2, 3, 4, 5, 6)
"""Orders of the sines of a joint's error, as in `rig moved`; the prior falls with the order."""
_CURVE = 2.0
"""Multiple of the usual amplitude for order 1: chosen, as strain-wave gears are accurate to about an arc minute."""
_OF_THE_BALL = ("q_deg", "d_mm")
"""Constants of the last axis that change only the position of the ball."""
_STEP = 0.01


@dataclass(frozen=True)
class Term:
    effect: Effect
    group: Group


@dataclass(frozen=True)
class PairArm:
    rig: Rig
    terms: tuple[Term, ...]

    @cached_property
    def model(self) -> Model:
        return model_of(self.rig)

    @property
    def axes(self) -> int:
        return self.model.arm.axes

    def poses(self, q: Array, times: Array) -> Array:
        """Tool poses (n, 4, 4) in the world at reported angles q (n, axes) rad, for multiples (terms,) of the terms."""
        added = effects_of([(term.effect, value) for term, value in zip(self.terms, times.tolist(), strict=True)])
        return moved(replace(self.model, effects=(*self.model.effects, *added)), visits(q)).T

    def slopes(self, q: Array, times: Array, point_mm: Array) -> Array:
        """Change (n, 3, terms) in mm of points (n, 3) on the tool, for one prior standard deviation of each term, at
        `times` (terms,).
        """
        begin = tool_points(self.poses(q, times), point_mm)
        columns = np.empty((len(q), 3, len(self.terms)))
        for k in range(len(self.terms)):
            step = times.copy()
            step[k] += _STEP
            columns[:, :, k] = (tool_points(self.poses(q, step), point_mm) - begin) / _STEP
        return columns


def tool_points(T: Array, point_mm: Array) -> Array:
    points: Array = T[:, :3, 3] + np.einsum("nij,nj->ni", T[:, :3, :3], np.broadcast_to(point_mm, (len(T), 3)))
    return points


def arm_terms(rig: Rig) -> tuple[Term, ...]:
    """Zeros, link constants, compliance, and curves of each joint.

    Without those that only change the base frame or the ball: all of axis 1, and zero and d of the last axis.
    """
    axes = rig.robot.axes
    scope = Scope(
        False, (), tuple(axis.alpha_deg for axis in axes), (1.0,) * len(axes), False, load_of(rig.robot).payload
    )
    forms = [form for cls in VOCABULARY.values() for seat in cls.forms(scope) for form in seat]
    grouped = [(group, form) for group in GROUPS for form in forms if _group_of(form, rig) == group]
    usual = [(group, scaled(healthy(form), form.usual_times(rig.reference))) for group, form in grouped]
    return tuple(
        Term(sine, group)
        for group, effect in usual
        for sine in (phases(scaled(effect, _CURVE / sine_of(effect)[1])) if group == "curves" else (effect,))
    )


def _group_of(form: Effect, rig: Rig) -> Group | None:
    """None if touches of two arms do not reveal a form, or if its shape would have to be fitted."""
    if form.STAGE not in ("arm", "joint") or (form.STRETCHED and not is_sine(form)):
        return None
    if constant := form.compensation().constant:
        axis, key = constant
        is_of_a_frame = axis == 1 or (axis == len(rig.robot.axes) and key in _OF_THE_BALL)
        return None if is_of_a_frame else "constants"
    if is_sine(form):
        return "curves" if sine_of(form)[1] in _ORDERS else None
    has_masses = rig.robot.payload_kg > 0 or any(joint.mass_kg for joint in rig.robot.axes)
    return "gravity" if form.STAGE == "joint" and form.part == "gravity" and has_masses else None


def scale_shares(arm: PairArm) -> Array:
    shares = np.zeros(len(arm.terms))
    for k, term in enumerate(arm.terms):
        constant = term.effect.compensation().constant
        if constant and constant[1].endswith("_mm"):
            length_mm = float(getattr(arm.rig.robot.axes[constant[0] - 1], constant[1]))
            shares[k] = 1e-3 * length_mm / float(getattr(term.effect, size_field(term.effect)))
    return shares

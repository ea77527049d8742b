"""Corrections in the words of a controller: the parameters to change, what each change is worth, and what it leaves.

An effect is entered where the controller has a parameter for it. Effects of which only the sum is known are entered all
or none, because one of them alone would displace the arm by what the others hold.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.correction.constants import Correction, joint_zeros, link_constants
from analysis.correction.controllers import CONTROLLERS, Controller
from analysis.correction.corrected_targets import Corrected
from analysis.correction.left_out import left_out_mm
from analysis.correction.support import Support
from analysis.correction.work import displaced_mm, position_u_mm, tool_poses, work_angles
from analysis.kinematics.arm import Array
from analysis.model.predict import model_of
from rigs.effects import Effect
from rigs.errors import UseError
from rigs.rig import Rig
from rigs.schema.effect import label_of
from rigs.schema.vocabulary import Maker


@dataclass(frozen=True)
class Entry:
    """One change at the controller: add `add` ± `u` (standard uncertainty) `unit` to `parameter` of an axis from 1.

    `reading_deg` is by how much the axis then reads more at an unchanged posture. `worth_um` is by how much the change
    moves the tool, root mean square over the work of the rig; `leaves_um` is the part of it that its uncertainty
    leaves.
    """

    axis: int
    parameter: str
    add: float
    u: float
    unit: str
    reading_deg: float
    worth_um: float
    leaves_um: float


@dataclass(frozen=True)
class NotEntered:
    """An effect for which the controller has no parameter, what it does to the tool over the work, root mean square,
    and whether corrected targets hold it."""

    effect: Effect
    worth_um: float
    by_path: bool


@dataclass(frozen=True)
class ControllerEntries:
    """All changes at one controller and what they leave.

    `entered` lists the effects that the entries hold. `before_um` and `after_um` are the error of the tool's position
    over the work, root mean square, without and with the changes; the latter has the uncertainty of the entered effects
    and all effects that are not entered. `steps` are for the person who enters the values.
    """

    name: Maker
    controller: Controller
    entries: tuple[Entry, ...]
    entered: tuple[Support, ...]
    not_entered: tuple[NotEntered, ...]
    before_um: float
    after_um: float
    steps: tuple[str, ...]


def controller_entries(
    rig: Rig, found: Sequence[Support], name: Maker, scale: Sequence[float] | None = None
) -> ControllerEntries:
    """Return the changes at a controller for the effects of a rig that it has parameters for.

    `scale` (6,) has the counts per degree, or the gear ratio, of each axis. Raises UseError for a scale that the
    controller has no use for.
    """
    controller = CONTROLLERS[name]
    if scale and not controller.scale:
        raise UseError("--scale", f"{controller.maker} takes {controller.unit}, without a scale", "leave it out")
    entered = _entered(found, controller)
    others = [one for one in found if one not in entered]
    q = work_angles(rig)
    corrections = [*joint_zeros(entered), *link_constants(rig, entered)]
    entries = [_entry(rig, controller, scale, one, _effects_of(one, entered), q) for one in corrections]
    return ControllerEntries(
        name,
        controller,
        tuple(entries),
        tuple(entered),
        tuple(NotEntered(one.effect, _rms_um(_position_error_mm(rig, [one], q)), one.use != "none") for one in others),
        _rms_um(_position_error_mm(rig, found, q)),
        _rms_um(np.hypot(_position_error_mm(rig, others, q), position_u_mm(rig, entered, q))),
        (*controller.steps, controller.check),
    )


def as_entered(rig: Rig, targets: Corrected, at: ControllerEntries) -> Corrected:
    """Return corrected targets for a controller at which the entries were made: the angles that its joints then read
    in the same postures, and the poses that it then computes there."""
    more_deg = np.zeros(6)
    for one in at.entries:
        more_deg[one.axis - 1] += one.reading_deg
    entered = model_of(rig, [one.effect for one in at.entered])
    return replace(targets, q=targets.q + np.radians(more_deg), T=tool_poses(entered, targets.q))


def _entered(found: Sequence[Support], controller: Controller) -> list[Support]:
    """Return the effects that the controller has parameters for, without those of which only a sum is known that it
    cannot hold whole."""
    kept = [one for one in found if _parameter(controller, one.effect) and one.use != "none"]
    while True:
        labels = {label_of(one.effect) for one in kept}
        rest = [one for one in kept if not one.effect.found or set(one.effect.found.together) <= labels]
        if len(rest) == len(kept):
            return rest
        kept = rest


def _coupled_axes(rig: Rig) -> set[int]:
    """Return the axes (from 1) whose angle at the controller goes with the motor of another axis, so that one count
    alone does not change one reading alone."""
    beside = np.array(rig.robot.coupling) - np.diag(np.diag(rig.robot.coupling))
    return {int(k) + 1 for k in np.flatnonzero(np.abs(beside).sum(axis=0) + np.abs(beside).sum(axis=1))}


def _place(effect: Effect) -> tuple[int, str]:
    return effect.compensation().constant or (0, "")


def _parameter(controller: Controller, effect: Effect) -> tuple[str, str, float] | None:
    """Return the parameter for an effect with its unit and the change for a degree or mm, or None without one."""
    axis, key = _place(effect)
    if key == "q_deg":
        return controller.zero.format(axis=axis), controller.unit, controller.per_deg
    for one in controller.constants:
        if one.key == key and axis > one.later:
            return f"{one.name}[{axis - one.later}]", one.unit, one.per_unit
    return None


def _effects_of(one: Correction, entered: Sequence[Support]) -> list[Effect]:
    return [each.effect for each in entered if _place(each.effect) == (one.axis, one.key)]


def _entry(
    rig: Rig, controller: Controller, scale: Sequence[float] | None, one: Correction, effects: list[Effect], q: Array
) -> Entry:
    named = _parameter(controller, effects[0])
    assert named is not None  # noqa: S101 - entered effects have one
    parameter, unit, per_unit = named
    if controller.scale and scale and one.axis not in _coupled_axes(rig):
        per_unit *= scale[one.axis - 1]
    elif controller.scale:
        parameter, unit, per_unit = f"reading of axis {one.axis}", "deg", 1.0
    worth_um = _rms_um(displaced_mm(rig, effects, q))
    leaves_um = worth_um * one.u / abs(one.delta) if one.delta else 0.0
    # A robot whose model is changed, and not its zero, reads what it read before.
    reading_deg = one.delta if one.key == "q_deg" and controller.changes_reading else 0.0
    add, u = per_unit * one.delta, abs(per_unit) * one.u
    return Entry(one.axis, parameter, add, u, unit, reading_deg, worth_um, leaves_um)


def _position_error_mm(rig: Rig, found: Sequence[Support], q: Array) -> Array:
    """Return the error of the tool's position, (n,) mm, from effects of all kinds: those that depend on the posture
    together, the others beside them."""
    postural = [one.effect for one in found if one.effect.compensation().use != "none"]
    others = [one.effect for one in found if one.effect.compensation().use == "none"]
    error: Array = np.hypot(displaced_mm(rig, postural, q), np.linalg.norm(left_out_mm(rig, others, q), axis=1))
    return error


def _rms_um(distance_mm: Array) -> float:
    return 1e3 * float(np.sqrt(np.mean(distance_mm**2)))

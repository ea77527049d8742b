"""Corrections in the words of a controller: the parameters to change, what each change is worth, and what all leave.

The whole model's error over the work is projected onto the parameters that the controller has. The work is always that
of the rig file, never that of a path, so that one rig file has one set of entries and targets for a controller that has
them stay right.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.correction.controllers import CONTROLLERS, Controller
from analysis.correction.corrected_targets import Corrected
from analysis.correction.left_out import left_out_mm
from analysis.correction.pose_uncertainty import displacements, frame_u_mm, pose_uncertainty, position_u_mm
from analysis.correction.projection import Constant, project
from analysis.correction.support import Support
from analysis.correction.taught_frame import base_u_um, rest_mm
from analysis.correction.work import (
    rest_effects,
    rms_um,
    spread_angles,
    tool_places,
    tool_poses,
    used_effects,
    work_or_spread,
)
from analysis.kinematics.arm import Array
from analysis.model.predict import model_of
from rigs.effects import Effect
from rigs.errors import UseError
from rigs.rig import Rig
from rigs.schema.vocabulary import Maker

_NO_MOVE_MM = 1e-9
"""A change of the tool below which an entry does nothing."""


@dataclass(frozen=True)
class Entry:
    """One change at the controller: add `add` ± `u` (standard uncertainty) `unit` to `parameter` of an axis from 1.

    `now` is the size of the value before, where only its growth is stated. `reading_deg` is by how much the axis then
    reads more at an unchanged posture. `worth_um` is by how much the change moves the tool, root mean square over the
    work of the rig; `leaves_um` is the part of it that its uncertainty leaves.
    """

    axis: int
    parameter: str
    add: float
    u: float
    unit: str
    now: float | None
    reading_deg: float
    worth_um: float
    leaves_um: float


@dataclass(frozen=True)
class NotEntered:
    """An effect that no constant and no target holds, and what it does to the tool over the work, root mean square."""

    effect: Effect
    worth_um: float


@dataclass(frozen=True)
class ControllerEntries:
    """All changes at one controller and what they leave.

    `effects` are the changes as effects of the nominal arm. `before_um` and `after_um` are the error of the tool's
    place over the work, root mean square, without and with the changes, `by_targets_um` with corrected targets; each
    has what nothing can correct, the latter two also the uncertainty of the model. `elsewhere_um` is the
    error of the model alone, without and with the changes, at postures spread over the joint angles of the work or the
    runs. All of these are in a frame that is taught with the robot at these postures. `base_u_um` is what the place of
    the whole arm on its base adds to the uncertainty of the model. `twins` names parameters of which only a combination
    is known.
    """

    name: Maker
    controller: Controller
    entries: tuple[Entry, ...]
    effects: tuple[Effect, ...]
    twins: tuple[tuple[str, ...], ...]
    not_entered: tuple[NotEntered, ...]
    before_um: float
    after_um: float
    by_targets_um: float
    elsewhere_um: tuple[float, float]
    base_u_um: float
    steps: tuple[str, ...]

    @property
    def carried_um(self) -> float:
        """How much of the error the entries take away."""
        return self.before_um - self.after_um

    @property
    def carried_by_targets_um(self) -> float:
        """How much of the error corrected targets take away."""
        return self.before_um - self.by_targets_um


def controller_entries(
    rig: Rig, supported: Sequence[Support], name: Maker, scale: Sequence[float] | None = None
) -> ControllerEntries:
    """Return the changes at a controller that hold most of a rig's model.

    `scale` (6,) has the counts per degree, or the gear ratio, of each axis. Raises UseError for a scale that the
    controller has no use for.
    """
    controller = CONTROLLERS[name]
    if scale and not controller.scale:
        raise UseError("--scale", f"{controller.maker} takes {controller.unit}, without a scale", "leave it out")
    used, uncorrected, uncertainty = (
        used_effects(rig, supported),
        rest_effects(rig, supported),
        pose_uncertainty(rig, supported),
    )
    spread, q = spread_angles(rig, uncertainty.joints_rad), work_or_spread(rig, uncertainty.joints_rad)
    projection = project(rig, used, _constants(rig, controller), q, spread)
    u = projection.u(displacements(uncertainty, np.concatenate([q, spread])))
    sizes = zip(
        projection.constants, projection.values.tolist(), u.tolist(), (1e3 * projection.worth_mm).tolist(), strict=True
    )
    entries = [_entry(rig, controller, scale, *size) for size in sizes]
    lengths = (controller.check_lengths,) if any(entry.now is not None for entry in entries) else ()
    left_mm = np.linalg.norm(left_out_mm(rig, uncorrected, q), axis=1)
    u_mm = frame_u_mm(rig, uncertainty, q, q)
    doubt_mm = np.hypot(u_mm, left_mm)
    return ControllerEntries(
        name,
        controller,
        tuple(entries),
        projection.effects,
        tuple(tuple(entries[k].parameter for k in group) for group in projection.twins),
        tuple(NotEntered(effect, rms_um(left_out_mm(rig, [effect], q)[:, 0])) for effect in uncorrected),
        rms_um(np.hypot(_apart_mm(rig, used, (), q), left_mm)),
        rms_um(np.hypot(_apart_mm(rig, used, projection.effects, q), doubt_mm)),
        rms_um(doubt_mm),
        (rms_um(_apart_mm(rig, used, (), spread)), rms_um(_apart_mm(rig, used, projection.effects, spread))),
        base_u_um(position_u_mm(uncertainty, q), u_mm),
        (*controller.steps, *lengths, controller.check),
    )


def as_entered(rig: Rig, targets: Corrected, at: ControllerEntries) -> Corrected:
    """Return corrected targets for a controller at which the entries were made: the angles that its joints then read
    in the same postures, and the poses that it then computes there."""
    added_deg, done = np.zeros(6), targets.done
    for entry in at.entries:
        added_deg[entry.axis - 1] += entry.reading_deg
    q, T = targets.q.copy(), targets.T.copy()
    q[done] += np.radians(added_deg)
    T[done] = tool_poses(model_of(rig, at.effects), targets.q[done])
    return replace(targets, q=q, T=T)


def _apart_mm(rig: Rig, effects: Sequence[Effect], others: Sequence[Effect], q: Array) -> Array:
    """Return how far (n,) mm the tool of a model stands from that of another at joint angles q (n, 6) rad, with
    frame and tool taught there."""
    return rest_mm(tool_places(rig, effects, q), tool_poses(model_of(rig, others), q))


def _constants(rig: Rig, controller: Controller) -> list[Constant]:
    """Return the constants of a rig's arm that a controller has."""
    kept = [Constant(axis, "q_deg") for axis in range(1, 7)]
    for parameter in controller.constants:
        kept += [
            Constant(axis, parameter.key)
            for axis in parameter.axes
            if not parameter.by_size or getattr(rig.robot.axes[axis - 1], parameter.key)
        ]
    return kept


def _coupled_axes(rig: Rig) -> set[int]:
    """Return the axes (from 1) whose angle at the controller goes with the motor of another axis, so that one count
    alone does not change one reading alone."""
    coupling = np.array(rig.robot.coupling) - np.diag(np.diag(rig.robot.coupling))
    return {int(k) + 1 for k in np.flatnonzero(np.abs(coupling).sum(axis=0) + np.abs(coupling).sum(axis=1))}


def _entry(
    rig: Rig, controller: Controller, scale: Sequence[float] | None, one: Constant, value: float, u: float, worth: float
) -> Entry:
    """Return the entry of a change by `value` ± `u` mm or degrees that is worth so many µm."""
    reading_deg, now = 0.0, None
    if one.key != "q_deg":
        parameter = next(each for each in controller.constants if each.key == one.key and one.axis in each.axes)
        name, unit, per_unit = parameter.of(one.axis), parameter.unit, parameter.per_unit
        if parameter.by_size:
            nominal = float(getattr(rig.robot.axes[one.axis - 1], one.key))
            per_unit, now = per_unit * np.sign(nominal), abs(per_unit * nominal)
    else:
        name, unit, per_unit = controller.zero.format(axis=one.axis), controller.unit, controller.per_deg
        if controller.scale and scale and one.axis not in _coupled_axes(rig):
            per_unit *= scale[one.axis - 1]
        elif controller.scale:
            name, unit, per_unit = f"reading of axis {one.axis}", "deg", 1.0
        # A robot whose model is changed, and not its zero, reads what it read before.
        reading_deg = value if controller.changes_reading else 0.0
    leaves_um = worth * u / abs(value) if worth > 1e3 * _NO_MOVE_MM else 0.0
    return Entry(one.axis, name, per_unit * value, abs(per_unit) * u, unit, now, reading_deg, worth, leaves_um)

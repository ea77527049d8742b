"""Corrections in the notation of a controller: parameters to change, the benefit of each, and the remaining error.

The constants of the controller are fitted to the error of the tool over the work area of the rig file, position and
orientation together. Zeros and lengths thereby absorb part of a compliant joint or a gear error.

Each constant has a prior of a few usual sizes, and the error that no constant represents counts as scatter, so a large
value is never chosen for a small gain. Constants with equal effects (d2 and d3 of parallel axes) share the error in
proportion to their usual sizes. A rotation of the tool counts as the displacement of its tip.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.apps.correct.work_area import WorkArea
from analysis.apps.makers import CHECK_LENGTH, Controller, maker_by
from analysis.apps.report.texts import ENGLISH
from analysis.correction.corrected_targets import CorrectedTargets
from analysis.correction.work import (
    TaughtFrame,
    base_u_um,
    largest_move_mm,
    real_model,
    rest_mm,
    rms_um,
    spread_angles,
    tool_places,
    tool_poses,
)
from analysis.diagnosis.evidence.significance import POSSIBLE_SIGMA
from analysis.robot.kinematics.arm import Array, arm_of, controller_robot, pose_error, reported_angles
from analysis.robot.predict import model_of
from rigs.effects import Effect, changed, turned
from rigs.errors import UseError
from rigs.rig import Rig
from rigs.schema.vocabulary import MakerName
from rigs.text import numbers_in

_LEVER_MM = 100.0
"""Minimum lever of a rotation of the tool. Chosen: about half a hand's width from a flange."""
_USUAL = 3.0
"""Prior of a constant, in healthy sizes. Chosen: an arm that needs correction is not quite healthy."""
_LEAST_MM = 1e-3
"""Minimum rms effect over the work area, in mm, of an entered constant, and of a determined combination of constants
of the expected sizes. Chosen: 1 µm, below the repeatability of any robot."""
_CRUMB = 0.01
"""Minimum share of the error for an entered constant: manual entries should be worthwhile."""
_OUTSIDE_WEIGHT = 0.1
"""Total weight of the postures outside the work area; all weights add up to 1. Tried on ur10e with a compliant joint
and a gear error: 0 left 93 µm in the work area and 696 µm outside (582 before), 0.1 left 134 and 329, 0.5 left
178 and 239."""
_SHARE = 0.3
"""Minimum share of a constant in an undetermined combination to be named as part of it."""
_ROUNDS = 4
"""Number of linear steps. Chosen: each leaves about a thousandth, because constants are wrong by about a thousandth."""


@dataclass(frozen=True)
class Constant:
    """A constant of a controller: axis from 1, and key as in the rig file. `q_deg` is the zero of a joint."""

    axis: int
    key: str

    def effect(self, value: float) -> Effect:
        return turned(self.axis, value) if self.key == "q_deg" else changed(self.axis, self.key, value)

    @property
    def usual(self) -> float:
        """Expected size of a change, in mm or degrees."""
        return _USUAL * self.effect(0.0).healthy


@dataclass(frozen=True)
class Projection:
    """Changes of m constants that represent most of the error of a model."""

    constants: tuple[Constant, ...]
    values: Array
    worth_mm: Array
    """Rms tool displacement (m,) by each change over the work area."""
    operator: Array
    """Maps (m, 6n) the weighted tool error to changes."""
    weights: Array
    twins: tuple[tuple[int, ...], ...]
    """Indices of constants with equal effects."""

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The changes as effects of the arm in the controller."""
        return _effects(self.constants, self.values)

    @property
    def is_possible(self) -> bool:
        """False if a change is outside the range of its effect, as those of constants that nearly cancel each other."""
        try:
            _ = self.effects
        except ValueError:  # of pydantic
            return False
        return True

    def changes(self, moves: Array) -> Array:
        """Changes (k, m) in mm or degrees for displacements (k, n, 6) mm and rad of the tool.

        For displacements of one standard uncertainty each, the sums of squares are the variances.
        """
        weighted = (moves * self.weights).reshape(len(moves), self.weights.size)  # including zero displacements
        return np.asarray(weighted @ self.operator.T)

    def without(self, out: Sequence[int], changes: Array) -> tuple[Projection, Array]:
        """Set the changes `out` to zero. Return the others on this condition, with their standard uncertainties.

        changes (k, m): result of `changes`. If only the sum of two changes is certain, the remaining one becomes the
        sum. Independent changes stay the same.
        """
        kept = [k for k in range(len(self.constants)) if k not in out]
        share = np.linalg.pinv(changes[:, out], 1e-9) @ changes[:, kept]
        values = self.values[kept] - self.values[list(out)] @ share
        projection = replace(
            self,
            constants=tuple(self.constants[k] for k in kept),
            values=values,
            worth_mm=self.worth_mm[kept] * np.abs(values / self.values[kept]),
            operator=self.operator[kept],
            twins=tuple(tuple(map(kept.index, group)) for group in self.twins if {*group} <= {*kept}),
        )
        return projection, np.linalg.norm(changes[:, kept] - changes[:, out] @ share, axis=0)

    def gains(self, fewer: Projection, rig: Rig, used: Sequence[Effect], q: Array, moves: Array) -> bool:
        """True if this projection certainly leaves less error over the work area q than one with fewer changes.

        moves (k, n and more, 6): argument of `changes`.
        """
        if not fewer.is_possible:
            return True
        now = at_controller(rig)
        real, nominal = tool_places(rig, used, q), tool_poses(model_of(now, ()), q)
        off_mm = [real - tool_places(now, projection.effects, q) for projection in (fewer, self)]
        in_base, frame = np.concatenate([off_mm, moves[:, : len(q), :3]]), TaughtFrame(nominal)
        for without, full, *by_u in (in_base, frame.remove_motions(in_base, nominal, frame.motions(in_base))):
            u = 2.0 * math.hypot(*(float((move * (without - full)).sum()) for move in by_u))
            if float((without**2).sum() - (full**2).sum()) > POSSIBLE_SIGMA * u:
                return True
        return False


def _effects(constants: Sequence[Constant], values: Array) -> tuple[Effect, ...]:
    return tuple(constant.effect(value) for constant, value in zip(constants, values.tolist(), strict=True))


def at_controller(rig: Rig) -> Rig:
    return rig.model_copy(update={"robot": controller_robot(rig.robot)})


def project(
    rig: Rig, effects: Sequence[Effect], constants: Sequence[Constant], work: Array, spread: Array
) -> Projection:
    """Fit the constants to the effects on the tool.

    work (n, 6), spread (k, 6): joint angles in rad inside and outside the work area. Constants without influence are
    omitted.
    """
    lever = max(_LEVER_MM, float(np.linalg.norm(rig.robot.tool.xyz_mm)))
    shares = np.repeat([(1 - _OUTSIDE_WEIGHT) / len(work), _OUTSIDE_WEIGHT / len(spread)], [len(work), len(spread)])
    weights = np.sqrt(shares)[:, None] * [1, 1, 1, lever, lever, lever]
    q, real = np.concatenate([work, spread]), tool_poses(real_model(rig, effects), np.concatenate([work, spread]))
    rig = at_controller(rig)
    base = tool_poses(model_of(rig, ()), q)
    least_mm = max(_LEAST_MM, _CRUMB * float(np.linalg.norm(pose_error(base, real) * weights)))
    first = _solved(rig, real, constants, q, weights)
    moves = [pose_error(base, tool_poses(model_of(rig, [effect]), q)) * weights for effect in first.effects]
    kept = [constant for constant, move in zip(first.constants, moves, strict=True) if np.linalg.norm(move) >= least_mm]
    solved = _solved(rig, real, kept, q, weights)
    each = [tool_poses(model_of(rig, [effect]), work) - base[: len(work)] for effect in solved.effects]
    worth_mm = [float(np.linalg.norm(move[:, :3, 3])) / np.sqrt(len(work)) for move in each]
    return replace(solved, worth_mm=np.array(worth_mm))


def _solved(rig: Rig, real: Array, constants: Sequence[Constant], q: Array, weights: Array) -> Projection:
    base = tool_poses(model_of(rig, ()), q)
    usual = np.array([constant.usual for constant in constants])
    columns = np.zeros((6 * len(q), len(constants)))
    for k, effect in enumerate(_effects(constants, usual)):
        columns[:, k] = (pose_error(base, tool_poses(model_of(rig, [effect]), q)) * weights).ravel()
    u, s, vt = np.linalg.svd(columns, full_matrices=False)
    determined = s > _LEAST_MM
    error = (pose_error(base, real) * weights).ravel()
    explained = u[:, determined] @ (u[:, determined].T @ error)
    scatter = float(((error - explained) ** 2).sum()) / len(q)
    shrunk = s[determined] / (s[determined] ** 2 + scatter)
    operator = (vt[determined].T * shrunk) @ u[:, determined].T
    sizes = np.zeros(len(constants))
    for _ in range(_ROUNDS):
        now = tool_poses(model_of(rig, _effects(constants, usual * sizes)), q)
        residual = (pose_error(now, real) * weights).ravel()
        sizes = operator @ (residual + columns @ sizes)
    twins = _twins(vt[~determined])
    return Projection(
        tuple(constants), usual * sizes, np.zeros(len(constants)), operator * usual[:, None], weights, twins
    )


def _twins(unknown: Array) -> tuple[tuple[int, ...], ...]:
    """Groups of constants of which only a combination is determined, given the directions without effect."""
    shared = unknown.T @ unknown
    groups = [
        tuple(np.flatnonzero(np.abs(row) > _SHARE * row[k]).tolist()) for k, row in enumerate(shared) if row[k] > _SHARE
    ]
    return tuple(dict.fromkeys(group for group in groups if len(group) > 1))


_NO_MOVE_MM = 1e-9
"""Tool displacement, in mm, below which an entry has no effect."""


@dataclass(frozen=True)
class ControllerChange:
    """A change at the controller: add `add` ± `u` (standard uncertainty) `unit` to `parameter`."""

    axis: int
    key: str
    """The constant as in the rig file, or `q_deg` for the zero of the joint."""
    parameter: str
    add: float
    u: float
    unit: str
    now: float | None
    """Previous size, if only the growth is stated."""
    reading_deg: float
    """Change of the axis reading at an unchanged posture, after all changes."""
    worth_um: float
    """Rms tool displacement by the change over the work area."""
    leaves_um: float
    """Part of worth_um remaining because of the uncertainty."""


@dataclass(frozen=True)
class ControllerEntries:
    """All changes at a controller, and the remaining rms error of the tool's position in a taught frame."""

    name: MakerName
    controller: Controller
    entries: tuple[ControllerChange, ...]
    readings_deg: tuple[float, ...]
    """Changes (6,) of the axis readings at an unchanged posture, also of axes whose reading follows from several
    drives."""
    effects: tuple[Effect, ...]
    """Changes as effects of the arm in the controller; empty if they remove no error."""
    twins: tuple[tuple[str, ...], ...]
    """Parameters of which only a combination is determined."""
    not_entered: tuple[tuple[Effect, float], ...]
    """Effects that neither constants nor targets represent, and their rms tool displacement over the work in µm."""
    before_um: float
    """Error over the work area before the changes, including the uncorrectable error."""
    after_um: float
    """The same after the changes, including the uncertainty of the model."""
    by_targets_um: float
    """The same with corrected targets."""
    elsewhere_um: tuple[float, float]
    """Error of the model before and after the changes, spread over the joint angles of the work area or the runs."""
    base_u_um: float
    """Contribution of the position of the arm on its base to the uncertainty."""
    steps: tuple[str, ...]
    taught_off_mm: float = 0.0
    """Largest error over the work area of points that were taught before the changes and not converted."""

    @property
    def carried_um(self) -> float:
        return self.before_um - self.after_um

    @property
    def carried_by_targets_um(self) -> float:
        return self.before_um - self.by_targets_um


def controller_entries(area: WorkArea, name: MakerName, scale: Sequence[float] | None = None) -> ControllerEntries:
    """Compute the changes at a controller that represent most of the model of a rig, judged over its work area.

    scale (6,): counts per degree or gear ratios of the axes. Raises UseError if the controller uses no scale.
    """
    controller = maker_by(name).controller
    if scale and not controller.scale:
        problem = f"must be omitted: {controller.maker} uses {controller.unit}, without a scale"
        raise UseError("--scale", problem, "remove it", code="usage")
    rig, used, q, uncertainty = area.rig, area.used, area.q, area.uncertainty
    spread = spread_angles(rig, uncertainty.joints_rad)
    moves = uncertainty.pose_displacements(np.concatenate([q, spread]))
    larger = _significant(rig, used, controller, (q, spread), moves)
    projection, u = _certain(rig, used, larger, q, moves)
    sizes = list(zip(projection.values.tolist(), u.tolist(), (1e3 * projection.worth_mm).tolist(), strict=True))
    of_drives = np.zeros(6)
    for constant, (value, *_) in zip(projection.constants, sizes, strict=True):
        if constant.key == "q_deg" and controller.changes_reading:
            of_drives[constant.axis - 1] += value
    readings_deg = reported_angles(arm_of(rig.robot), of_drives)
    entries = [
        _entry(rig, controller, scale, readings_deg, constant, size)
        for constant, size in zip(projection.constants, sizes, strict=True)
    ]
    left_mm = np.linalg.norm(area.left_out_mm, axis=1)
    in_base_mm, u_mm = area.u_mm
    doubt_mm = np.hypot(u_mm, left_mm)
    before_um = rms_um(np.hypot(_apart_mm(rig, used, (), q), left_mm))
    after_um = rms_um(np.hypot(_apart_mm(rig, used, projection.effects, q), doubt_mm))
    effects, twins = projection.effects, projection.twins
    if after_um >= before_um:
        entries, effects, twins, after_um, readings_deg = [], (), (), before_um, np.zeros(6)
    lengths = (CHECK_LENGTH,) if any(entry.now is not None for entry in entries) else ()
    taught_off_mm = largest_move_mm(at_controller(rig), effects) if effects else 0.0
    by_hand = (*controller.steps, *_coupled_step(entries, readings_deg), *lengths, controller.check)
    steps = (str(ENGLISH("entries_taught", mm=f"{taught_off_mm:.2g}")), *by_hand) if entries else ()
    return ControllerEntries(
        name,
        controller,
        tuple(entries),
        tuple(readings_deg.tolist()),
        effects,
        tuple(tuple(entries[k].parameter for k in group) for group in twins),
        tuple((effect, rms_um(mm)) for effect, mm in zip(area.uncorrected, area.left_out_mm.T, strict=True)),
        before_um,
        after_um,
        rms_um(doubt_mm),
        (rms_um(_apart_mm(rig, used, (), spread)), rms_um(_apart_mm(rig, used, effects, spread))),
        base_u_um(in_base_mm, u_mm),
        steps,
        taught_off_mm,
    )


def _significant(
    rig: Rig, used: Sequence[Effect], controller: Controller, postures: tuple[Array, Array], moves: Array
) -> Projection:
    """Project onto constants with changes above the standard uncertainty; others are removed in turn."""
    constants, axes = [Constant(axis, "q_deg") for axis in range(1, 7)], controller_robot(rig.robot).axes
    for parameter in controller.constants:
        constants += [
            Constant(axis, parameter.key)
            for axis in parameter.axes
            if not parameter.by_size or getattr(axes[axis - 1], parameter.key)
        ]
    while True:
        projection = project(rig, used, constants, *postures)
        u, sizes = np.linalg.norm(projection.changes(moves), axis=0), np.abs(projection.values)
        if (sizes > u).all():
            return projection
        least = int(np.argmin(np.where(sizes > u, np.inf, sizes / u)))
        constants = [constant for k, constant in enumerate(projection.constants) if k != least]


def _certain(rig: Rig, used: Sequence[Effect], every: Projection, q: Array, moves: Array) -> tuple[Projection, Array]:
    """Reduce a projection to changes that exceed their uncertainty and certainly reduce the error over the work area q.

    Returns their standard uncertainties too. moves: displacements of the tool as for `Projection.changes`.
    """
    changes, needed, out = every.changes(moves), list[int](), list[int]()
    while True:
        projection, u = every.without(out, changes)
        kept = np.setdiff1d(np.arange(len(every.constants)), out)
        times_u = np.where(u > 0, np.abs(projection.values) / np.where(u > 0, u, 1.0), np.inf)
        if (times_u < 1.0).any():  # After the removal of other changes it is smaller than its uncertainty.
            out.append(int(kept[np.argmin(times_u)]))
            continue
        undecided = [k for k in kept[np.argsort(times_u)].tolist() if k not in needed]
        if not undecided:
            return projection, u
        fewer, _ = every.without([*out, undecided[0]], changes)
        (needed if every.gains(fewer, rig, used, q, moves) else out).append(undecided[0])


def as_entered(rig: Rig, targets: CorrectedTargets, at: ControllerEntries) -> CorrectedTargets:
    """Corrected targets for a controller with the entries: readings of the same postures, and poses it computes."""
    q, T, done = targets.q.copy(), targets.T.copy(), targets.done
    q[done] += np.radians(at.readings_deg)
    T[done] = tool_poses(model_of(at_controller(rig), at.effects), targets.q[done])
    return replace(targets, q=q, T=T)


def _apart_mm(rig: Rig, effects: Sequence[Effect], others: Sequence[Effect], q: Array) -> Array:
    """Distance (n,) mm of the real tool from the pose computed by a controller with other effects, frame and tool
    taught."""
    return rest_mm(tool_places(rig, effects, q), tool_poses(model_of(at_controller(rig), others), q))


_SAME_READING_DEG = 5e-5
"""Change of a reading that rounds to zero in the display."""


def _coupled_step(entries: Sequence[ControllerChange], readings_deg: Array) -> tuple[str, ...]:
    """Instruction for axes whose readings change with the zero of another drive."""
    entered = {entry.axis for entry in entries if entry.key == "q_deg"}
    follow = [k for k in np.flatnonzero(np.abs(readings_deg) >= _SAME_READING_DEG).tolist() if k + 1 not in entered]
    if not follow:
        return ()
    changes = " and ".join(f"of axis {k + 1} by {readings_deg[k]:+z.4f}°" for k in follow)
    return (f"The reading {changes} changes with the zeros above: leave the zero of this axis.",)


def _entry(
    rig: Rig,
    controller: Controller,
    scale: Sequence[float] | None,
    readings_deg: Array,
    constant: Constant,
    size: tuple[float, float, float],
) -> ControllerChange:
    """Entry of a change. size: change and its u in mm or degrees, and the benefit in µm."""
    add, u, worth_um = size
    leaves_um = worth_um * u / abs(add) if worth_um > 1e3 * _NO_MOVE_MM else 0.0
    reading_deg, now = 0.0, None
    if constant.key != "q_deg":
        parameter = next(
            each for each in controller.constants if each.key == constant.key and constant.axis in each.axes
        )
        name, unit, per_unit = parameter.of(constant.axis), parameter.unit, parameter.per_unit
        if parameter.by_size:
            nominal = float(getattr(controller_robot(rig.robot).axes[constant.axis - 1], constant.key))
            per_unit, now = per_unit * np.sign(nominal), abs(per_unit * nominal)
    else:
        name, unit, per_unit = controller.zero_of(constant.axis), controller.unit, controller.per_deg
        reading_deg = float(readings_deg[constant.axis - 1])
        if controller.scale and scale:
            per_unit *= scale[constant.axis - 1]
        elif controller.scale:
            name, unit, per_unit, add = f"reading of axis {constant.axis}", "deg", 1.0, reading_deg
    sizes = (per_unit * add, abs(per_unit) * u, unit, now, reading_deg, worth_um, leaves_um)
    return ControllerChange(constant.axis, constant.key, name, *sizes)


def scale_of(text: str | None) -> tuple[float, ...] | None:
    """Parse the scale of each axis (6,) from a comma-separated list; None for None.

    Raises UseError unless there are six non-zero numbers.
    """
    if text is None:
        return None
    scale = numbers_in(text)
    if len(scale) != 6 or not all(scale):
        problem, remedy = (
            f"{text!r} is not a list of six nonzero numbers",
            "give a number per axis, separated by commas",
        )
        raise UseError("--scale", problem, remedy, code="usage")
    return scale

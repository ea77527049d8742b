"""Corrected targets: commands that move the real arm to the wanted poses.

The real arm is the model with the correctable effects. The command is shifted by the error of the real arm until the
error vanishes. Because effects are small, each round leaves about a thousandth. A corrected pose is the pose that the
controller computes at the corrected angles, with the constants that it has (`controller_arm`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.correction.pose_uncertainty import (
    PoseUncertainty,
    covered,
    places_u_mm,
    pose_uncertainty,
    where_known,
    why_unknown,
)
from analysis.correction.reasons import Reason
from analysis.correction.support import Support, why_nothing
from analysis.correction.work import (
    FEWEST_TAUGHT,
    base_u_um,
    left_out_mm,
    real_model,
    rest_effects,
    rest_mm,
    rms_um,
    taught_angles,
    tool_places,
    tool_poses,
    used_effects,
)
from analysis.diagnosis.evidence.observation import BEYOND_MM, outside_coverage
from analysis.robot.kinematics.arm import (
    RAIL_MM,
    Arm,
    Array,
    Mask,
    arm_of,
    controller_arm,
    forward,
    pose_error,
    rail_mm,
)
from analysis.robot.kinematics.joint_limits import turned_into
from analysis.robot.kinematics.newton import newton, newton_in_part, turned_rad
from analysis.robot.predict import Model
from rigs.rig import Rig
from rigs.schema.effect import label_of
from rigs.schema.vocabulary import DRIVEN_AXES

_ROUNDS = 20
"""Limit of rounds. Chosen: each reduces the error about a thousandfold, so two or three are usual."""
_REACHED = 1e-6
"""Error in mm, with a radian counted as 1 m, of a reached target: 1 nm, below any resolution."""
_SINGULAR = "cannot be corrected: the arm is at a singularity"
GAIN_UM = 1.0
"""Minimum gain of a correction in µm. Chosen: below the repeatability of any robot."""


@dataclass(frozen=True)
class WorkError:
    """RMS position error of the tool over the work area, or over targets, in µm, with the frame taught there."""

    before_um: float
    """Uncorrected."""
    after_um: float
    """With corrected targets: the standard uncertainty, including `u_um` of the model and the uncorrectable
    error.
    """
    u_um: float
    base: InBase
    """The same errors in the robot's base."""
    base_u_um: float
    """Contribution of the arm's position on the base to the uncertainty."""
    model_um: float
    """Correctable part."""
    unknown: float
    """Share of postures not covered by runs, for which these figures are estimates of the model."""
    taught_elsewhere: bool = False
    """The targets are too few to teach a frame, so it is taught over the measured region; `before_um` is then at
    most that in the base, which the correction removes.
    """

    @classmethod
    def of(cls, sizes_mm: Array, inside: Mask | None, *, taught_elsewhere: bool = False) -> WorkError:
        """RMS error of displaced positions.

        sizes_mm (5, n): displacement in the base and in a taught frame, uncertainties in both, and uncorrectable part.
        inside: mask of covered positions.
        """
        off_mm, taught_mm, u_mm, u_frame_mm, stays_mm = sizes_mm

        def errors(off_mm: Array, u_mm: Array) -> tuple[float, float, float]:
            return rms_um(np.hypot(off_mm, stays_mm)), rms_um(np.hypot(u_mm, stays_mm)), rms_um(u_mm)

        unknown = 0.0 if inside is None else float(np.mean(~inside))
        in_base, base_u = InBase(*errors(off_mm, u_mm)), base_u_um(u_mm, u_frame_mm)
        return cls(*errors(taught_mm, u_frame_mm), in_base, base_u, rms_um(taught_mm), unknown, taught_elsewhere)

    @property
    def gains(self) -> bool:
        return max(self.before_um - self.after_um, self.base.before_um - self.base.after_um) >= GAIN_UM


@dataclass(frozen=True)
class InBase:
    """Position error of the tool in the robot's base, µm, as in `WorkError`."""

    before_um: float
    after_um: float
    u_um: float


@dataclass(frozen=True)
class NotCorrected:
    """Unchanged target: index from 0, reason as a value, and as text with the target as the subject."""

    place: int
    reason: Reason
    what: str
    errors_mm: tuple[float, float] | None = None
    """Smallest and largest error over its postures, if the posture is unknown."""


@dataclass(frozen=True)
class CorrectedTargets:
    """Targets of a path with their corrections. Values of uncorrected targets are NaN."""

    q: Array
    """Corrected angles (n, 6) rad."""
    T: Array
    """Poses (n, 4, 4) that the controller computes at these angles; NaN if its constants are unknown."""
    missed_mm: Array
    """Error (n,) caused by the corrected effects."""
    left_out: tuple[str, ...]
    """Names of the uncorrected effects."""
    left_out_mm: Array
    """RMS error (n, e) of each uncorrected effect."""
    u_mm: Array
    """Standard uncertainty (n,) of the position in the robot's base, from the model and uncorrected effects;
    NaN if not covered.
    """
    u_frame_mm: Array
    """The same in a frame taught with the robot over these targets."""
    covered: Mask | None
    """Mask (n,) of targets in the range of the runs; None if that is unknown."""
    doubts: tuple[str, ...]
    """About all targets, as text."""
    done: Mask
    """Mask (n,) of corrected targets."""
    left: tuple[NotCorrected, ...]
    """The uncorrected targets."""
    unknown: tuple[str, ...]
    """Reason (n,) for an unknown uncertainty; empty if covered."""
    error: WorkError | None
    """At the corrected and covered targets; None if none exist."""


def corrected(
    rig: Rig,
    supported: Sequence[Support],
    q: Array,
    unsolved: Sequence[NotCorrected] = (),
    wanted: Array | None = None,
) -> CorrectedTargets:
    """Correct targets for the correctable effects.

    q (n, 6) rad: joint angles to which the controller moves. wanted (n, 4, 4): poses that the targets mean, by default
    those of the arm in the rig file at q. Targets that have no angles, exceed the limits or are at a singularity remain
    uncorrected.
    """
    wanted = forward(arm_of(rig.robot), q) if wanted is None else wanted
    angles, done, skipped = corrected_angles(rig, supported, q, unsolved, wanted)
    uncertainty = pose_uncertainty(rig, supported)
    uncorrected, arm = rest_effects(rig, supported), controller_arm(rig.robot)

    def spread(values: Array) -> Array:
        """Return values of the corrected targets (m, …) at their indices among all (n, …), NaN elsewhere."""
        everywhere = np.full((len(q), *values.shape[1:]), np.nan)
        everywhere[done] = values
        return everywhere

    at = angles[done]
    inside = covered(uncertainty, at)
    left_out = left_out_mm(rig, uncorrected, at)
    stays_mm = np.linalg.norm(left_out, axis=1)
    used, nominal = used_effects(rig, supported), wanted[done]
    rows = slice(None) if inside is None else inside
    taught, frame = q[done][rows], nominal[rows]
    if too_few := len(taught) < FEWEST_TAUGHT:
        taught = taught_angles(rig, uncertainty.joints_rad)[:, : q.shape[1]]  # a rail at zero is left out
        frame = forward(arm, taught)
    u_mm, u_frame_mm = places_u_mm(rig, uncertainty, at, taught)
    before, marks, unknown = tool_places(rig, used, q[done]), None, np.full(len(q), "", dtype=object)
    if inside is not None:
        marks = np.zeros(len(q), dtype=bool)
        marks[done] = inside
        unknown[done] = why_unknown(rig, uncertainty, at)
    distance: Array = np.linalg.norm(before - nominal[:, :3, 3], axis=1)
    taught_mm = rest_mm(before, nominal, (tool_places(rig, used, taught), frame))
    taught_mm = np.minimum(taught_mm, distance) if too_few else taught_mm
    sizes_mm = np.array([distance, taught_mm, u_mm, u_frame_mm, stays_mm])
    sizes_mm = sizes_mm if inside is None else sizes_mm[:, inside]
    return CorrectedTargets(
        angles,
        np.full((len(q), 4, 4), np.nan) if rig.controller == "unknown" else forward(arm, angles),
        spread(distance),
        tuple(map(label_of, uncorrected)),
        spread(left_out),
        spread(where_known(uncertainty, at, np.hypot(u_mm, stays_mm))),
        spread(where_known(uncertainty, at, np.hypot(u_frame_mm, stays_mm))),
        marks,
        (*_doubts(rig, uncertainty, at), *_turned(rig, supported, nominal, at)),
        done,
        tuple(skipped),
        tuple(unknown.tolist()),
        WorkError.of(sizes_mm, inside, taught_elsewhere=too_few) if sizes_mm.size else None,
    )


def corrected_angles(
    rig: Rig,
    supported: Sequence[Support],
    q: Array,
    unsolved: Sequence[NotCorrected] = (),
    wanted: Array | None = None,
) -> tuple[Array, Mask, list[NotCorrected]]:
    """Only the corrected angles (n, 6) rad, the mask (n,), and the uncorrected targets, as for `corrected`."""
    model = real_model(rig, used_effects(rig, supported))
    wanted = forward(arm_of(rig.robot), q) if wanted is None else wanted
    skipped = {target.place: target for target in unsolved}
    beyond = beyond_limits(model.arm, q)
    if rig.robot.rail is not None:
        (low, high), mm = rig.robot.rail.limits_mm, rail_mm(arm_of(rig.robot), q)
        beyond += [
            NotCorrected(
                k, "beyond_limits", f"the rail would be at {mm[k]:g} mm, beyond the limits {low:g} and {high:g} mm"
            )
            for k in np.flatnonzero((mm < low) | (mm > high)).tolist()
        ]
    skipped |= {target.place: target for target in beyond if target.place not in skipped}
    done = np.array([k not in skipped for k in range(len(q))], dtype=bool)
    angles, reached = q.copy(), done.copy()
    angles[done], reached[done] = reached_angles(model, wanted[done], q[done])
    skipped |= {k: singular(k) for k in np.flatnonzero(done & ~reached).tolist()}
    skipped |= {target.place: target for target in beyond_limits(model.arm, angles) if reached[target.place]}
    done = np.array([k not in skipped for k in range(len(q))], dtype=bool)
    angles[~done] = q[~done]
    return angles, done, [skipped[k] for k in sorted(skipped)]


def reached_angles(model: Model, wanted: Array, q: Array) -> tuple[Array, Mask]:
    """Angles (n, axes) rad with the tool of a model at poses `wanted` (n, 4, 4), and the mask (n,) of solutions.

    The search starts at q, where the nominal arm is close to `wanted`. With fewer than six axes, the position is
    reached with the closest possible orientation.
    """
    if model.arm.axes < DRIVEN_AXES:
        return newton_in_part(model.arm, wanted, q, lambda angles: tool_poses(model, angles))
    command, angles, reached_wanted = wanted.copy(), q.copy(), np.zeros(len(q), dtype=bool)
    rows = np.arange(len(q))
    for _ in range(_ROUNDS):
        reached = tool_poses(model, angles[rows])
        near = (np.abs(pose_error(reached, wanted[rows])) * [1, 1, 1, 1e3, 1e3, 1e3]).max(axis=1) < _REACHED
        reached_wanted[rows[near]] = True
        rows = rows[~near]
        if not len(rows):
            break
        command[rows] = command[rows] @ np.linalg.inv(reached[~near]) @ wanted[rows]
        angles[rows], good = newton(model.arm, command[rows], angles[rows])
        rows = rows[good]
    return angles, reached_wanted


def _doubts(rig: Rig, uncertainty: PoseUncertainty, q: Array) -> list[str]:
    inside = covered(uncertainty, q)
    if inside is None or uncertainty.joints_rad is None or inside.all():
        return []
    counted = f"{int((~inside).sum())} of {len(q)} targets are at places without a known uncertainty"
    axes = len(rig.robot.axes)
    ranges = [(low, high) for low, high in np.degrees(uncertainty.joints_rad[:axes]).tolist()]
    first = f"{counted}: the column covered is no and u is empty; measure there for an uncertainty"
    rail = RAIL_MM * uncertainty.joints_rad[axes:]
    stands = [
        f"the model: the rail is at {mm.min():.0f} to {mm.max():.0f} mm, in the runs at {low:.0f} to {high:.0f} mm"
        for (low, high), mm in zip(rail, RAIL_MM * q[:, axes:].T, strict=False)
        if mm.min() < low - BEYOND_MM or mm.max() > high + BEYOND_MM
    ]
    far, reach_mm = int((~uncertainty.is_within_reach(q)).sum()), rig.calibrated.reach_mm if rig.calibrated else None
    if far and reach_mm is not None and not why_nothing(rig):
        beyond = f"farther than {reach_mm:.0f} mm from every touched socket, without validation there"
        stands.append(f"the model: {far} of {len(q)} targets are {beyond}")
    return [first, *outside_coverage(ranges, q, "the model"), *stands]


def _turned(rig: Rig, supported: Sequence[Support], wanted: Array, at: Array) -> list[str]:
    """Remarks on the rotation error that remains if an arm has fewer than six axes. wanted (n, 4, 4), at (n, axes) rad:
    poses of the targets, and corrected angles.
    """
    if (axes := len(rig.robot.axes)) >= DRIVEN_AXES or not len(at):
        return []
    really = tool_poses(real_model(rig, used_effects(rig, supported)), at)
    most_deg = float(np.degrees(turned_rad(really, wanted).max()))
    return [
        f"an arm of {axes} axes turns the tool in {axes - 3} ways at a position: each position is corrected, and the "
        f"tool stays turned by up to {most_deg:.2g}°"
    ]


def singular(place: int) -> NotCorrected:
    return NotCorrected(place, "singular", _SINGULAR)


def beyond_limits(arm: Arm, q: Array) -> list[NotCorrected]:
    """Points with readings q (n, axes) rad beyond the limits of an arm."""
    joints = q[:, : arm.axes]
    outside = (joints < arm.limits[:, 0] - 1e-9) | (joints > arm.limits[:, 1] + 1e-9)
    beyond: dict[int, NotCorrected] = {}
    for k, axis in np.argwhere(outside).tolist():
        low, high = np.degrees(arm.limits[axis])
        stands = f"axis {axis + 1} would be at {np.degrees(q[k, axis]):.3f}°, beyond the limits {low:g}° and {high:g}°"
        turned = float(np.degrees(turned_into(joints[k], arm.limits)[axis]))
        stands += f"; {turned:.3f}° is the same posture" * bool(low <= turned <= high)
        beyond.setdefault(k, NotCorrected(k, "beyond_limits", stands))
    return list(beyond.values())

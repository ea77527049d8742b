"""Positions that share the correction of a target, although they would need a different one.

A point has a single set of numbers. A move with an offset adds the offset to these numbers, so an approach shares the
correction of its work point. A controller that uses only the position of an arc's via point passes it in an orientation
between start and end, but the via point is corrected at the orientation written there. The work point and the written
orientation come first; the remaining error of the others is computed here.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from analysis.apps.correct.postures import arc_to_via
from analysis.apps.makers.program_machine import Unknown
from analysis.apps.makers.target import AT_BEGIN, Arc, Target, TargetMove
from analysis.correction.corrected_targets import CorrectedTargets, corrected_angles
from analysis.correction.reasons import Reason
from analysis.correction.support import Support
from analysis.robot.kinematics.arm import Arm, Array, forward
from rigs.rig import Rig

REMAINING_SHARE = 0.1
"""Remaining error, as a share of the uncorrected error, above which a position is listed. Chosen: a tenth is small
compared with the uncertainty of most corrections."""

_SINGULAR: Reason = "singular"


@dataclass(frozen=True)
class SharedCorrection:
    """A position that keeps an error, because it shares the correction of a target.

    before_mm, after_mm: distance of the tool from the intended position without and with the correction, NaN if
    unknown. unknown: the reason for unknown distances.
    """

    file: int
    line: int
    name: str
    kind: Literal["offset", "via"]
    before_mm: float
    after_mm: float
    unknown: Reason | None = None


@dataclass
class SharedCorrections:
    """Positions with a remaining error, remaining errors (n,) mm of the moves to each target with an offset, NaN if
    there are none, and points that no correction suits, with the reason and the move causing it."""

    kept_mm: Array
    listed: dict[int, list[SharedCorrection]] = field(default_factory=dict)
    refused: dict[int, tuple[Reason, Unknown]] = field(default_factory=dict)

    def of(self, targets: Sequence[int]) -> tuple[SharedCorrection, ...]:
        """Return the listed positions that share the correction of these targets, in the order of the program, for
        each move the worst."""
        worst: dict[tuple[int, int, str], SharedCorrection] = {}
        for position in (position for k in targets for position in self.listed.get(k, ())):
            key = position.file, position.line, position.kind
            if key not in worst or not position.after_mm <= worst[key].after_mm:
                worst[key] = position
        return tuple(worst[key] for key in sorted(worst))

    def add(self, k: int, position: SharedCorrection, bound_mm: float) -> None:
        """List a position that shares the correction of target k, if its error exceeds the bound."""
        if not position.after_mm <= bound_mm:
            self.listed.setdefault(k, []).append(position)


@dataclass(frozen=True)
class Correction:
    """The corrected targets of a program.

    arm: arm in the controller. q (n, 6), nominal (n, 4, 4): its joint angles in rad and poses before the correction.
    tips (n, 3): points in mm that the program moves, in the frame of the arm's tool. reasons: of the uncorrected
    targets.
    """

    arm: Arm
    q: Array
    done: CorrectedTargets
    nominal: Array
    tips: Array
    reasons: Mapping[int, Reason]

    def tip(self, k: int, T: Array) -> Array:
        """Return the position (3,) mm of the program's tool for a pose T (4, 4) of the arm's tool at target k."""
        position: Array = (T @ np.append(self.tips[k], 1.0))[:3]
        return position

    def is_allowed(self, k: int) -> bool:
        """Return whether the nominal angles at target k are within the limits."""
        low, high = self.arm.limits.T
        return bool(((self.q[k] >= low) & (self.q[k] <= high)).all())

    def bound_mm(self, k: int, before_mm: float) -> float:
        """Return the remaining error of a position that need not be listed: the uncertainty or the share."""
        u_mm = min(self.done.u_mm[k], self.done.u_frame_mm[k])
        return float(np.fmax(u_mm, REMAINING_SHARE * before_mm))  # Without an uncertainty, the share is the limit.


def add_offsets(
    shared: SharedCorrections,
    correction: Correction,
    targets: Sequence[Target],
    commanded: Mapping[int, Array],
    moves: Sequence[TargetMove],
) -> None:
    """Add the moves to points with an offset.

    commanded: pose (4, 4) of the arm's tool commanded for a target with an offset from its corrected point. A point
    that the program reaches is corrected there, whatever its approaches keep. A point that is used only with offsets is
    refused if any position would be farther off than before, or cannot be computed. Any point is refused if the
    correction might move a position beyond a limit or its posture flags.
    """
    reached = {move.target for move in moves}
    for k, target in enumerate(targets):
        point = target.of
        if point is None or point in correction.reasons:
            continue
        unknown = correction.reasons.get(k)
        before_mm = after_mm = np.nan
        bound_mm = 0.0
        if unknown is None:
            wanted = correction.tip(k, correction.done.T[k])
            before_mm, after_mm = (
                float(np.linalg.norm(correction.tip(k, T) - wanted)) for T in (correction.nominal[k], commanded[k])
            )
            bound_mm = correction.bound_mm(k, before_mm)
            shared.kept_mm[point] = np.fmax(shared.kept_mm[point], after_mm)
        move = Unknown(target.file, target.line, "the move with the offset")
        if unknown in ("changes_flags", "beyond_limits") and correction.is_allowed(k):
            shared.refused[point] = unknown, move  # The controller could not reach the position any more.
        elif point not in reached and not after_mm <= max(before_mm, bound_mm):
            shared.refused[point] = "offset", move
        position = SharedCorrection(target.file, target.line, target.name, "offset", before_mm, after_mm, unknown)
        shared.add(point, position, bound_mm)


def add_vias(
    shared: SharedCorrections,
    correction: Correction,
    rig: Rig,
    supported: Sequence[Support],
    targets: Sequence[Target],
    moves: Sequence[TargetMove],
) -> None:
    """Add the via points of arcs that a controller may pass in another orientation than written."""
    passed = list(_passed(correction, moves))
    if not passed:
        return
    at = np.array([angles for _, angles in passed])
    angles, done, _ = corrected_angles(rig, supported, at, wanted=forward(correction.arm, at))
    for (k, _), wanted, solved in zip(passed, forward(correction.arm, angles), done, strict=True):
        before_mm, after_mm = (
            float(np.linalg.norm(correction.tip(k, T) - correction.tip(k, wanted))) if solved else np.nan
            for T in (correction.nominal[k], correction.done.T[k])
        )
        target, unknown = targets[k], None if solved else _SINGULAR
        position = SharedCorrection(target.file, target.line, target.name, "via", before_mm, after_mm, unknown)
        shared.add(k, position, correction.bound_mm(k, before_mm))


def _passed(correction: Correction, moves: Sequence[TargetMove]) -> Iterator[tuple[int, Array]]:
    """Yield the via points of arcs, each with the joint angles (6,) rad at which the arm passes it."""
    arm, q = correction.arm, correction.q
    known = {k for k in range(len(q)) if k not in correction.reasons}
    arcs: dict[Arc, None] = {move.arc: None for move in moves if move.arc and not move.arc.tangent}
    for arc in arcs:
        via, end = arc.through, arc.end
        if via is None or via not in known or end is None or not np.isfinite(q[end]).all():
            continue
        for start in arc.starts:
            if start not in (None, AT_BEGIN) and np.isfinite(q[start]).all():
                poses = correction.nominal[[start, via, end]]
                passed = arc_to_via(arm, q[start], poses, correction.tips[via])
                if passed is not None:
                    yield via, passed

"""Positions that share the correction of a target, although they would need a different one.

An approach with an offset shares the numbers of its work point. Some controllers pass the via point of an arc in an
orientation between start and end, but it is corrected at the orientation written there. The work point and the written
orientation come first; the remaining error of the others is computed here.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from analysis.apps.correct.postures import arc_to_via
from analysis.apps.correct.solved_program import SolvedProgram, with_offset
from analysis.apps.makers.program_machine import Unknown
from analysis.apps.makers.target import AT_BEGIN, Arc
from analysis.correction.corrected_targets import CorrectedTargets, corrected_angles
from analysis.correction.reasons import Reason
from analysis.correction.support import Support
from analysis.robot.kinematics.arm import Array, forward
from rigs.rig import Rig

REMAINING_SHARE = 0.1
"""Remaining share of the error above which a position is listed. Chosen: a tenth is small compared with the
uncertainty of most corrections."""


@dataclass(frozen=True)
class SharedCorrection:
    """A position that keeps an error, because it shares the correction of a target."""

    file: int
    line: int
    name: str
    kind: Literal["offset", "via"]
    before_mm: float
    """Error without the correction, NaN if unknown."""
    after_mm: float
    """The same with the correction."""
    unknown: Reason | None = None
    """Reason for unknown distances."""


@dataclass
class SharedCorrections:
    kept_mm: Array
    """Largest remaining error (n,) of the moves to each target with an offset, NaN without such moves."""
    listed: dict[int, list[SharedCorrection]] = field(default_factory=dict)
    """Positions with a remaining error, by target."""
    refused: dict[int, tuple[Reason, Unknown]] = field(default_factory=dict)
    """Points that no correction suits, with the reason and the move causing it."""

    def of(self, targets: Sequence[int]) -> tuple[SharedCorrection, ...]:
        """The listed positions of targets in program order, for each move the worst."""
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
    """The corrected targets of a program, and the reasons for the uncorrected ones."""

    program: SolvedProgram
    done: CorrectedTargets
    reasons: Mapping[int, Reason]

    def off_mm(self, k: int, T: Array, wanted: Array) -> float:
        """Distance of the program's tool between two poses (4, 4) of the arm's tool at target k."""
        return float(np.linalg.norm(self.program.tip(k, T) - self.program.tip(k, wanted)))

    def is_allowed(self, k: int) -> bool:
        """True if the nominal angles at target k are within the limits."""
        low, high = self.program.arm.limits.T
        return bool(((self.program.q[k] >= low) & (self.program.q[k] <= high)).all())

    def bound_mm(self, k: int, before_mm: float) -> float:
        """Error up to which a position is not listed: the uncertainty or the share."""
        u_mm = min(self.done.u_mm[k], self.done.u_frame_mm[k])
        return float(np.fmax(u_mm, REMAINING_SHARE * before_mm))  # Without an uncertainty, the share is the limit.


def shared_corrections(correction: Correction, rig: Rig, supported: Sequence[Support]) -> SharedCorrections:
    shared = SharedCorrections(np.full(len(correction.program.targets), np.nan))
    _add_offsets(shared, correction)
    _add_vias(shared, correction, rig, supported)
    return shared


def _add_offsets(shared: SharedCorrections, correction: Correction) -> None:
    """Add the moves to points with an offset.

    A point that is used only with offsets is refused if any position would be farther off than before, or cannot be
    computed. Any point is refused if the correction might move a position beyond a limit or its posture flags.
    """
    program, T = correction.program, correction.done.T
    reached = {move.target for move in program.parsed.steps}
    for k, target in enumerate(program.targets):
        point = target.of
        if point is None or point in correction.reasons:
            continue
        unknown = correction.reasons.get(k)
        before_mm = after_mm = np.nan
        bound_mm = 0.0
        if unknown is None:
            X = with_offset(target, program.located[point].in_program(T[point]))
            before_mm = correction.off_mm(k, program.nominal[k], T[k])
            after_mm = correction.off_mm(k, program.located[k].in_world(X), T[k])
            bound_mm = correction.bound_mm(k, before_mm)
            shared.kept_mm[point] = np.fmax(shared.kept_mm[point], after_mm)
        move = Unknown(target.file, target.line, "the move with the offset")
        if unknown in ("changes_flags", "beyond_limits") and correction.is_allowed(k):
            shared.refused[point] = unknown, move  # The controller could not reach the position any more.
        elif point not in reached and not after_mm <= max(before_mm, bound_mm):
            shared.refused[point] = "offset", move
        position = SharedCorrection(target.file, target.line, target.name, "offset", before_mm, after_mm, unknown)
        shared.add(point, position, bound_mm)


def _add_vias(shared: SharedCorrections, correction: Correction, rig: Rig, supported: Sequence[Support]) -> None:
    """Add the via points of arcs that a controller may pass in another orientation than written."""
    program, passed = correction.program, list(_passed(correction))
    if not passed:
        return
    at = np.array([angles for _, angles in passed])
    angles, done, _ = corrected_angles(rig, supported, at, wanted=forward(program.arm, at))
    for (k, _), wanted, solved in zip(passed, forward(program.arm, angles), done, strict=True):
        before_mm, after_mm = (
            correction.off_mm(k, T, wanted) if solved else np.nan for T in (program.nominal[k], correction.done.T[k])
        )
        target = program.targets[k]
        unknown: Reason | None = None if solved else "singular"
        position = SharedCorrection(target.file, target.line, target.name, "via", before_mm, after_mm, unknown)
        shared.add(k, position, correction.bound_mm(k, before_mm))


def _passed(correction: Correction) -> Iterator[tuple[int, Array]]:
    """Via points of arcs, each with the joint angles (6,) rad at which the arm passes it."""
    program, q = correction.program, correction.program.q
    arcs: dict[Arc, None] = {move.arc: None for move in program.parsed.steps if move.arc and not move.arc.tangent}
    for arc in arcs:
        via, end = arc.through, arc.end
        if via is None or via in correction.reasons or end is None or not np.isfinite(q[end]).all():
            continue
        for start in arc.starts:
            if start not in (None, AT_BEGIN) and np.isfinite(q[start]).all():
                passed = arc_to_via(program.arm, q[start], program.nominal[[start, via, end]], program.tips[via])
                if passed is not None:
                    yield via, passed

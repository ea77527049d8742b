"""Positions that share the correction of a target, although they would need a different one.

An approach with an offset shares the numbers of its work point. Some controllers pass the via point of an arc in an
orientation between start and end, but it is corrected at the orientation written there. The work point and the written
orientation come first; the remaining error of the others is computed here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from analysis.apps.correct.postures import arc_to_via
from analysis.apps.correct.solved_program import SolvedProgram, with_offset
from analysis.apps.makers.program_machine import Unknown
from analysis.apps.makers.target import AT_BEGIN, Arc
from analysis.correction.point_origins import NewPoints, PointOrigin
from analysis.correction.reasons import Reason
from analysis.robot.kinematics.arm import Array, forward

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
    """Positions that share the corrections of a program, apart from targets with reasons to stay uncorrected."""

    program: SolvedProgram
    done: NewPoints
    reasons: Mapping[int, Reason]
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

    def add(
        self, of: int, k: int, kind: Literal["offset", "via"], reached: Array, wanted: Array, unknown: Reason | None
    ) -> tuple[float, float, float]:
        """List position k, if its error with the correction of target `of` exceeds a bound.

        reached, wanted (4, 4): poses of the arm's tool. Returns the errors before and after in mm, and the bound.
        """
        target, before_mm, after_mm, bound_mm = self.program.targets[k], np.nan, np.nan, 0.0
        if unknown is None:
            *tips, intended = (self.program.tip(k, T) for T in (self.program.nominal[k], reached, wanted))
            before_mm, after_mm = (float(np.linalg.norm(tip - intended)) for tip in tips)
            u_mm = min(self.done.u_mm[k], self.done.u_frame_mm[k])
            bound_mm = float(np.fmax(u_mm, REMAINING_SHARE * before_mm))  # Without an uncertainty, the share.
        if not after_mm <= bound_mm:
            position = SharedCorrection(target.file, target.line, target.name, kind, before_mm, after_mm, unknown)
            self.listed.setdefault(of, []).append(position)
        return before_mm, after_mm, bound_mm


def shared_corrections(
    program: SolvedProgram,
    done: NewPoints,
    reasons: Mapping[int, Reason],
    origin_of: Callable[[int], PointOrigin],
) -> SharedCorrections:
    shared = SharedCorrections(program, done, reasons, np.full(len(program.targets), np.nan))
    _add_offsets(shared)
    passed = [(via, angles) for via, angles in _passed(program, reasons) if not origin_of(via).is_unchanged]
    for via, at in passed:
        origin = origin_of(via)
        angles, solved = origin.readings(at[None])
        shared.add(via, via, "via", done.T[via], forward(origin.arm, angles)[0], None if solved[0] else "singular")
    return shared


def _add_offsets(shared: SharedCorrections) -> None:
    """Add the moves to points with an offset.

    A point that is used only with offsets is refused if any position would be farther off than before, or cannot be
    computed. Any point is refused if the correction might move a position beyond a limit or its posture flags.
    """
    program, T = shared.program, shared.done.T
    used_itself = {move.target for move in program.parsed.steps}
    low, high = program.arm.limits.T
    for k, target in enumerate(program.targets):
        point = target.of
        if point is None or point in shared.reasons:
            continue
        unknown = shared.reasons.get(k)
        reached = program.located[k].in_world(with_offset(target, program.located[point].in_program(T[point])))
        before_mm, after_mm, bound_mm = shared.add(point, k, "offset", reached, T[k], unknown)
        shared.kept_mm[point] = np.fmax(shared.kept_mm[point], after_mm)
        move = Unknown(target.file, target.line, "the move with the offset")
        was_allowed = bool(((program.q[k] >= low) & (program.q[k] <= high)).all())
        if unknown in ("changes_flags", "beyond_limits") and was_allowed:
            shared.refused[point] = unknown, move  # The controller could not reach the position any more.
        elif point not in used_itself and not after_mm <= max(before_mm, bound_mm):
            shared.refused[point] = "offset", move


def _passed(program: SolvedProgram, reasons: Mapping[int, Reason]) -> Iterator[tuple[int, Array]]:
    """Via points of arcs that a controller may pass in another orientation than written, with the angles there."""
    q = program.q
    arcs: dict[Arc, None] = {move.arc: None for move in program.parsed.steps if move.arc and not move.arc.tangent}
    for arc in arcs:
        via, end = arc.through, arc.end
        if via is None or via in reasons or end is None or not np.isfinite(q[end]).all():
            continue
        for start in arc.starts:
            if start not in (None, AT_BEGIN) and np.isfinite(q[start]).all():
                passed = arc_to_via(program.arm, q[start], program.nominal[[start, via, end]], program.tips[via])
                if passed is not None:
                    yield via, passed

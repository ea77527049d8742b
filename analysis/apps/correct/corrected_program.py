"""A user's program with corrected targets: all other bytes are unchanged, and uncorrected targets are listed.

A computed joint target becomes the joint angles that put the real tool where the arm of the data sheet has it. A pose
becomes the pose that the controller computes at the angles at which the real tool is right. For a taught point, this is
the place where it was taught.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from analysis.apps.correct.postures import UNSTATED, ProgramPostures, agreeing
from analysis.apps.correct.shared_corrections import SharedCorrection, SharedCorrections, shared_corrections
from analysis.apps.correct.solved_program import SolvedProgram, solve_program
from analysis.apps.correct.stated_frames import NO_FRAMES, Frames
from analysis.apps.correct.stated_points import StatedPoints
from analysis.apps.makers.numbers import frame_numbers, frame_of, joint_numbers, joints_of, replaced, written
from analysis.apps.makers.points import is_moved
from analysis.apps.makers.reading import as_bytes
from analysis.apps.makers.target import (
    AT_BEGIN,
    NamedFrame,
    Notice,
    Number,
    Parsed,
    ProgramTexts,
    Target,
    UncorrectedTarget,
)
from analysis.correction.corrected_targets import NotCorrected, WorkError
from analysis.correction.point_origins import NewPoints, PointOrigin, merged
from analysis.correction.reasons import Reason
from analysis.robot.description.controller_constants import largest_correction_mm
from analysis.robot.kinematics.arm import Array, forward, pose_error
from rigs.errors import FileError
from rigs.schema.vocabulary import MakerName

_MOST_DEG, _MOST_JOINT_DEG = 1.0, 10.0
"""Largest turns written, with the displacement of `largest_correction_mm`. A joint that turns by 10° is near a
singularity."""

_SAME_POSE = 1e-9
"""Difference of two poses, in mm, below which the numbers stay: below the decimals of any language."""


@dataclass(frozen=True)
class Programs:
    paths: Sequence[Path] = ()
    frames: Frames = NO_FRAMES
    whole: bool = False
    """Write only programs with all targets corrected."""
    postures: ProgramPostures = UNSTATED
    again: bool = False
    """Also correct programs that rig has already corrected."""
    points: StatedPoints | None = None
    """Origins of the points; None without programs."""


@dataclass(frozen=True)
class PointGroup:
    """The points of a program with one origin, and the effect of their new numbers."""

    origin: PointOrigin
    names: tuple[str, ...]
    """Of the points with new numbers, or that are right as they are."""
    moved_mm: Array
    """Change (n,) of the numbers, as the distance of the poses that they state."""
    tool_mm: Array
    """Displacement (n,) of the tool from its taught place, or of a computed point from its place without a
    correction."""
    u_mm: Array
    """Standard uncertainty (n,) of the tool's place in the robot's base."""
    error: WorkError | None
    """Error of the tool with the old and the new numbers, None if it is exactly known."""


@dataclass(frozen=True)
class CorrectedProgram:
    """A program with n corrected targets."""

    path: Path
    maker: MakerName
    files: dict[str, bytes]
    """By name; of a directory only the changed files."""
    names: tuple[str, ...]
    places: tuple[tuple[int, int], ...]
    """File and line of each corrected target."""
    moved_mm: Array
    """Displacement (n,) of each target."""
    u_mm: Array
    """Standard uncertainty (n,) in the robot's base."""
    u_frame_mm: Array
    """The same with frame and tool taught with the robot."""
    unknown: tuple[str, ...]
    """Reason why the uncertainty is NaN; empty if the runs cover the target."""
    groups: tuple[PointGroup, ...]
    """By origin; an origin without points is left out."""
    rounded_um: Array
    """Error (n,) by the decimals of the numbers."""
    left: tuple[UncorrectedTarget, ...]
    beside_left_mm: Array
    """Displacement between the ends of each move from a corrected to an uncorrected target or back."""
    sources: tuple[str, ...]
    """Names of the files numbered in `left`."""
    overruled: tuple[NamedFrame, ...]
    """Tools and frames with different numbers in the program than stated by the user."""
    given_away_mm: Array
    """Largest error (n,) of the moves that share the correction of a target with an offset; NaN without such moves."""
    shared: tuple[SharedCorrection, ...] = ()
    """Positions that keep an error, because they share the correction of a target."""
    changed: frozenset[str] = frozenset()
    """Names of the changed files."""
    notices: tuple[Notice, ...] = ()
    named: frozenset[tuple[str, str]] = frozenset()
    """Tools and frames that the user can state, by kind and name."""
    held: bool = False
    """True if the program is not written, because it is corrected only in part."""
    start: tuple[float, ...] | None = None
    """Joint angles (6,) rad at the start as stated by the user, if the posture of a target may depend on them."""
    needs_model: bool = True
    """False if the points are right as they are, or only converted."""
    near: tuple[float, ...] | None = None
    """Joint angles (6,) rad as stated by the user for targets without a posture in the program, if they are used."""
    by_user: tuple[tuple[int, int], ...] = ()
    """File and line of each corrected target at which only `near` states the posture."""
    neutral: tuple[str, ...] = ()
    """Routines that change nothing, as stated by the user."""
    missing: tuple[str, ...] = ()
    """Called routines without text and unknown instructions, which the user can state as neutral."""
    points: tuple[tuple[str, int, str], ...] = ()
    """File, line and name of every point of the program."""

    @property
    def is_right(self) -> bool:
        """True if every point is right as it is, so that nothing is written."""
        return bool(self.groups) and all(group.origin.is_unchanged for group in self.groups)

    @property
    def judged(self) -> tuple[PointGroup, ...]:
        """Groups whose correction depends on a model of the arm and must reduce the error."""
        return tuple(group for group in self.groups if not group.origin.is_exact and group.names)

    @property
    def error(self) -> WorkError | None:
        """Error at the corrected targets, None if none was corrected by a model."""
        return next((group.error for group in self.judged if group.error), None)

    @property
    def gains(self) -> bool:
        """True if new numbers are certainly better for the points of any origin."""
        return any(group.error is not None and group.error.gains for group in self.judged) or any(
            group.origin.is_exact and not group.origin.is_unchanged and group.names for group in self.groups
        )


def correct_program(
    points: StatedPoints,
    path: Path,
    frames: Frames = NO_FRAMES,
    scale: Sequence[float] | None = None,
    *,
    whole: bool = False,
    postures: ProgramPostures = UNSTATED,
) -> CorrectedProgram:
    """Write new numbers for all points of a program for which they are certain.

    whole: hold the program if any target of a move stays uncorrected. Raises FileError for an invalid program.
    """
    program = solve_program(points.then, path, frames, scale, postures, points.is_taught)
    texts, parsed, targets = program.texts, program.parsed, program.targets
    done = _new_points(program, points)
    moved_mm = _moved_mm(program, done)
    flags = _flags_after(program, points, done)
    reasons = _refused(program, points, done, flags, moved_mm)
    shared = shared_corrections(program, done, reasons, lambda k: _origin(program, points, k))
    reasons |= {k: why for k, (why, _) in shared.refused.items()}
    own = [k for k, target in enumerate(targets) if target.of is None and target.file < texts.own]
    right = {k for k in own if _origin(program, points, k).is_unchanged}
    kept = [k for k in own if k not in reasons and k not in right]
    left = _uncorrected(program, points, {k: reasons[k] for k in own if k in reasons and k not in right}, shared)
    new = _new_texts(program, done, flags, kept)
    after = _read_back(program, new)
    rounded_um = {k: _off_um(program, points, k, after.targets[k], done.T[k]) for k in kept}
    changed = frozenset(name for name, old, text in zip(texts.names, texts.texts, new, strict=False) if old != text)
    files = dict(zip(texts.names, map(as_bytes, new), strict=False))
    return CorrectedProgram(
        path=path,
        maker=program.maker.name,
        files={name: data for name, data in files.items() if name in changed or not path.is_dir()},
        names=tuple(targets[k].name for k in kept),
        places=tuple((targets[k].file, targets[k].line) for k in kept),
        moved_mm=moved_mm[kept],
        u_mm=done.u_mm[kept],
        u_frame_mm=done.u_frame_mm[kept],
        unknown=tuple(done.unknown[k] for k in kept),
        groups=_groups(program, points, done, moved_mm, rounded_um, right),
        rounded_um=np.array([*rounded_um.values()]),
        left=left,
        beside_left_mm=moved_mm[_beside_left(parsed, set(kept), right)],
        sources=(*texts.names, *texts.unread),
        overruled=_overruled(parsed, frames),
        given_away_mm=shared.kept_mm[kept],
        shared=shared.of(kept),
        changed=changed,
        notices=(*parsed.notices, *_offline(program, kept), *_unread(texts)),
        named=parsed.named,
        held=whole and any(target.reason != "unused" for target in left),
        start=postures.start if _needs_start(parsed) else None,
        needs_model=points.uses_model,
        near=postures.near if program.by_user else None,
        by_user=tuple((targets[k].file, targets[k].line) for k in kept if k in program.by_user),
        neutral=texts.neutral,
        missing=parsed.missing,
        points=(*(_called(texts, targets[k]) for k in own), *(_called(texts, one) for one in parsed.left)),
    )


def _origin(program: SolvedProgram, points: StatedPoints, k: int) -> PointOrigin:
    return points.of_kind("taught" if program.taught[k] else "computed")


def _new_points(program: SolvedProgram, points: StatedPoints) -> NewPoints:
    """New numbers of all targets, each by its origin."""
    parts = []
    for kind, mask in program.kinds:
        if mask.any():
            reasons = program.reasons | dict.fromkeys(np.flatnonzero(~mask).tolist(), "unused")
            unsolved = [NotCorrected(k, why, "") for k, why in reasons.items()]
            parts.append((mask, points.of_kind(kind).renew(program.q, program.wanted, unsolved)))
    return merged(parts) if parts else points.origin.renew(program.q, program.wanted)


def _moved_mm(program: SolvedProgram, done: NewPoints) -> Array:
    """Distance (n,) between the poses that the old and the new numbers state. The angles of a joint target state them
    with the old constants of the controller: new constants do not change its numbers."""
    joints = np.array([target.joints for target in program.targets], dtype=bool)
    places = np.where(joints[:, None], forward(program.arm, done.q)[:, :3, 3], done.T[:, :3, 3])
    return np.asarray(np.linalg.norm(places - program.nominal[:, :3, 3], axis=1))


def _uncorrected(
    program: SolvedProgram, points: StatedPoints, reasons: Mapping[int, Reason], shared: SharedCorrections
) -> tuple[UncorrectedTarget, ...]:
    """Targets with reasons to stay uncorrected, and points that are no targets, in the order of the text."""
    others = [one for one in program.parsed.left if not points.is_right(*_called(program.texts, one))]
    for k, why in reasons.items():
        target = program.targets[k]
        others.append(UncorrectedTarget(target.file, target.line, target.name, why, shared.refused.get(k, ())[1:]))
    return tuple(sorted(others, key=lambda one: (one.file, one.line)))


def _called(texts: ProgramTexts, point: Target | UncorrectedTarget) -> tuple[str, int, str]:
    """File, line and name of a point."""
    return texts.names[point.file], point.line, point.name


def _overruled(parsed: Parsed, frames: Frames) -> tuple[NamedFrame, ...]:
    return tuple(
        named
        for named in parsed.sets
        if (stated := frames.stated(named.kind, named.name)) is not None
        and not np.allclose(stated.ravel(), named.value, atol=1e-6)
    )


def _offline(program: SolvedProgram, kept: Sequence[int]) -> list[Notice]:
    fact = (
        "joint targets are taken as computed with the data sheet; targets that were computed with the controller's own "
        "constants should stay as they are"
    )
    first = next((program.targets[k] for k in kept if k in program.offline), None)
    return [Notice(first.file, first.line, fact)] if first else []


def _groups(
    program: SolvedProgram,
    points: StatedPoints,
    done: NewPoints,
    moved_mm: Array,
    rounded_um: Mapping[int, float],
    right: set[int],
) -> tuple[PointGroup, ...]:
    groups = []
    for kind, mask in program.kinds:
        origin = points.of_kind(kind)
        rows = [k for k in np.flatnonzero(mask).tolist() if k in (right if origin.is_unchanged else rounded_um)]
        rounded_mm = np.array([rounded_um.get(k, 0.0) / 1e3 for k in rows])
        moved = np.zeros(len(rows)) if origin.is_unchanged else moved_mm[rows]
        tool_mm = moved if kind == "computed" else rounded_mm
        names = tuple(program.targets[k].name for k in rows)
        if rows:
            groups.append(PointGroup(origin, names, moved, tool_mm, done.u_mm[rows], done.errors.get(kind)))
    return tuple(groups)


def _unread(texts: ProgramTexts) -> list[Notice]:
    fact = "the file is encoded or binary and was not read: rig knows neither its routines nor what they write"
    return [Notice(len(texts.names) + k, 1, fact) for k in range(len(texts.unread))]


def _needs_start(parsed: Parsed) -> bool:
    """True if the posture of a target depends on the start of the program."""
    first = [(parsed.targets[step.target], step) for step in parsed.steps if AT_BEGIN in step.comes_from]
    return any(not of.joints and not of.near and not (of.flags and step.by_flags) for of, step in first)


def _beside_left(parsed: Parsed, kept: set[int], right: set[int]) -> list[int]:
    """The corrected target of each move whose other target is neither corrected nor right as it is."""
    base = [k if target.of is None else target.of for k, target in enumerate(parsed.targets)]
    ends_kept = [base[k] for k in parsed.next_to_left if base[k] in kept]
    for step in parsed.steps:
        for source in step.comes_from:
            ends = [] if source in (None, AT_BEGIN) else [base[step.target], base[source]]
            corrected_ends = [k for k in ends if k in kept]
            ends_kept += corrected_ends if len(corrected_ends) == 1 and not right & {*ends} else []
    return ends_kept


def _refused(
    program: SolvedProgram,
    points: StatedPoints,
    done: NewPoints,
    flags: Mapping[int, tuple[int, ...] | None],
    moved_mm: Array,
) -> dict[int, Reason]:
    """Reasons for targets that stay uncorrected, also because of their flags or an implausible correction."""
    reasons = program.reasons | {target.place: target.reason for target in done.left}
    reasons |= {k: "changes_flags" for k, values in flags.items() if values is None}
    reasons |= {k: "reference" for k, target in enumerate(program.targets) if target.is_reference}
    places = np.array(
        [k for k in np.flatnonzero(done.done) if not _origin(program, points, int(k)).is_exact], dtype=int
    )
    turned = pose_error(done.T[places], forward(program.arm, program.q[places]))[:, 3:]
    turned_deg = np.degrees(np.linalg.norm(turned, axis=1))
    joint_deg = np.degrees(np.abs(done.q[places] - program.q[places])).max(axis=1, initial=0.0)
    most_mm = largest_correction_mm(points.then.robot)
    large = (moved_mm[places] > most_mm) | (turned_deg > _MOST_DEG) | (joint_deg > _MOST_JOINT_DEG)
    reasons |= dict.fromkeys(places[large].tolist(), "too_large")
    if points.then.robot.rail is not None:  # It carries the arm to another place of a pose.
        poses = ((k, target) for k, target in enumerate(program.targets) if not target.joints)
        moved = (k for k, target in poses if any(is_moved(coordinate) for _, coordinate in target.external))
        reasons |= dict.fromkeys(moved, "external_axes")
    return reasons


def _flags_after(program: SolvedProgram, points: StatedPoints, done: NewPoints) -> dict[int, tuple[int, ...] | None]:
    """New values of flags that do not agree with the corrected angles, None if rig cannot write them.

    After a change of quadrant or sign, old flags would lead to the angle a full turn away. A move with an offset uses
    the flags of its point.
    """
    changed = dict[int, tuple[int, ...] | None]()
    for k in np.flatnonzero(done.done).tolist():
        target, old, new = program.targets[k], program.q[k], done.q[k]
        flags, arm = target.flags, _origin(program, points, k).arm
        if flags is None or np.array_equal(new, old):
            continue
        of_point = None if target.of is None else changed.get(target.of)
        if of_point is not None:
            flags = replace(flags, values=of_point)
        # Tolerance of the flags: the rounding in the program, or zero if the old angles agreed exactly.
        steps = np.radians([0.0, 1e-5, 1e-4, 1e-3, 2e-2])
        slack = next((float(step) for step in steps if agreeing(program.arm, old[None], flags, float(step))[0]), 0.0)
        if agreeing(arm, new[None], flags, 0.0 if of_point else slack)[0]:
            continue
        changed[k] = None
        if flags.renewed and target.of is None and not target.unknown_offsets:
            renewed = flags.renewed(arm, new)
            values = (*renewed, *flags.values[len(renewed) :])
            if agreeing(arm, new[None], replace(flags, values=values), 0.0)[0]:
                changed[k] = values
    return changed


def _new_texts(
    program: SolvedProgram,
    done: NewPoints,
    flags: Mapping[int, tuple[int, ...] | None],
    kept: Sequence[int],
) -> tuple[str, ...]:
    """The texts with the numbers of the corrected targets `kept`. Unchanged targets keep their bytes."""
    own = program.texts.texts[: program.texts.own]
    changes: list[list[tuple[Number, str]]] = [[] for _ in own]
    for k in kept:
        target = program.targets[k]
        is_same_pose = target.joints or np.allclose(done.T[k], program.nominal[k], rtol=0.0, atol=_SAME_POSE)
        if np.array_equal(done.q[k], program.q[k]) and is_same_pose:
            continue
        changes[target.file] += _new_numbers(program, k, done)
        if target.flags and (values := flags.get(k)):
            pairs = zip(target.flags.numbers, values, strict=False)
            changes[target.file] += [(number, str(value)) for number, value in pairs if number.value != value]
    return tuple(map(replaced, own, changes))


def _new_numbers(program: SolvedProgram, k: int, done: NewPoints) -> list[tuple[Number, str]]:
    target, form = program.targets[k], program.maker.reader.decimals
    if target.joints:
        values, decimals = joint_numbers(target.form, done.q[k], program.scale), [form.turn] * 6
    else:
        old = np.array([number.value for number in target.numbers])
        values = frame_numbers(target.form, program.located[k].in_program(done.T[k]), old)
        decimals = [form.place] * 3 + [form.turn] * (len(values) - 3)
    text = program.texts.texts[target.file]
    return [
        (number, written(number, text, value, target.form, places))
        for number, value, places in zip(target.numbers, values.tolist(), decimals, strict=True)
    ]


def _read_back(program: SolvedProgram, new: tuple[str, ...]) -> Parsed:
    """Parse the new texts. Raises FileError unless they contain the same targets."""
    texts = program.texts
    after = program.maker.reader.parse(replace(texts, texts=(*new, *texts.texts[texts.own :])))

    before, now = (
        ([(target.name, target.file, target.line) for target in parsed.targets], parsed.steps, parsed.left)
        for parsed in (program.parsed, after)
    )
    if before != now:
        problem, remedy = "cannot be read back as the same program", "please report this with the program"
        raise FileError("the corrected program", problem, remedy, code="correction.impossible")
    return after


def _off_um(program: SolvedProgram, points: StatedPoints, k: int, target: Target, meant: Array) -> float:
    """Distance in µm between the tool position written for target k and the intended pose `meant` (4, 4)."""
    if target.joints:
        T = forward(_origin(program, points, k).arm, joints_of(target, program.scale)[None])[0]
    else:
        T = program.located[k].in_world(frame_of(target.form, [number.value for number in target.numbers]))
    return float(np.linalg.norm(T[:3, 3] - meant[:3, 3])) * 1e3

"""A user's program with corrected targets: all other bytes are unchanged, and uncorrected targets are listed.

A joint target becomes the joint angles that put the real tool where the arm of the data sheet has it. A pose becomes
the pose that the controller computes at the angles at which the real tool is right. If the constants of the controller
are unknown, poses are not corrected. Nothing is sent to a robot.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from analysis.apps.correct.postures import agreeing, solved
from analysis.apps.correct.shared_corrections import (
    Correction,
    SharedCorrection,
    SharedCorrections,
    add_offsets,
    add_vias,
)
from analysis.apps.makers import Maker
from analysis.apps.makers.numbers import frame_numbers, frame_of, is_frame, joint_numbers, joints_of, replaced, written
from analysis.apps.makers.points import is_moved
from analysis.apps.makers.program_reader import ProgramReader
from analysis.apps.makers.reading import as_bytes, read_program
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
from analysis.correction.corrected_targets import CorrectedTargets, NotCorrected, WorkError, corrected
from analysis.correction.reasons import Reason
from analysis.correction.support import Support
from analysis.robot.kinematics.arm import Arm, Array, arm_of, controller_arm, forward, pose_error, transform
from rigs.arms import load_arm
from rigs.errors import FileError, UseError
from rigs.rig import Rig
from rigs.schema.robot import Pose, Robot
from rigs.schema.vocabulary import MakerName
from rigs.text import numbers_in

MOST_MM, _MOST_DEG, _MOST_JOINT_DEG = 10.0, 1.0, 10.0
"""Largest corrections written. A zero wrong by half a degree moves a tool at 1.1 m by 10 mm. A larger error means
that the arm must be mastered, or the rig file belongs to a different arm. A joint that turns by 10° is near a
singularity."""


_HOW = "write NAME=X,Y,Z,RX,RY,RZ in mm and degrees, roll-pitch-yaw about fixed axes"
_NEAREST_MM = 5.0
"""Distance below which a non-zero tool or frame was probably stated in metres. Chosen: no arm is longer than 5 m."""
_FARTHEST_MM = 1e6
"""Maximum distance of a frame: a kilometre is a typing error."""
_MOST_TURNED_DEG = 1000.0
"""Maximum joint angle: arms turn less than three times."""


@dataclass(frozen=True)
class Frames:
    """Statements of the user on the controller.

    tools, frames: frames (4, 4) in mm by name, in lower case; tools from the flange, user frames from the robot's base.
    neutral: names of routines without a text that neither move the arm nor change tools, frames, registers or
    displacements.
    """

    tools: Mapping[str, Array]
    frames: Mapping[str, Array]
    neutral: tuple[str, ...] = ()


NO_FRAMES = Frames({}, {})
"""No stated frames: frames only named in a program are unknown."""


@dataclass(frozen=True)
class Programs:
    """Programs to correct, and options for them.

    frames: tools and frames stated by the user. whole: write only programs with all targets corrected. start: joint
    angles (6,) rad of the arm when the programs start. again: also correct programs that rig has already corrected.
    """

    paths: Sequence[Path] = ()
    frames: Frames = NO_FRAMES
    whole: bool = False
    start: tuple[float, ...] | None = None
    again: bool = False


@dataclass(frozen=True)
class CorrectedProgram:
    """A program with corrected targets.

    files: bytes of each file by name, of a directory only of the changed files. names, places (n,): name, file and line
    of the n corrected targets. moved_mm (n,): displacement of each target. u_mm, u_frame_mm (n,): standard uncertainty
    in the robot's base, and with frame and tool taught with the robot. unknown (n,): reason for unknown uncertainties,
    which are then NaN; empty if the runs cover the target. rounded_um (n,): error by the decimals of the numbers.
    error: error at the targets, None if no target was corrected. left: uncorrected targets.

    beside_left_mm (m,): displacement of a corrected target relative to an uncorrected neighbour, for each move between
    two such targets. sources: names of the files numbered in `left`. overruled: tools and frames with different numbers
    in the program than stated by the user. given_away_mm (n,): remaining error of moves to a target with an offset,
    which share the correction of the target; NaN if there is no such move. shared: positions that keep an error,
    because they share the correction of a target. changed: names of the changed files. named:
    tools and frames that the user can state, by kind and name. notices: facts for the user. held: the program is not
    written, because it would be corrected only in part. start: joint angles (6,) rad at the start as stated by the
    user, if the posture of a target may depend on them.
    """

    path: Path
    maker: MakerName
    files: dict[str, bytes]
    names: tuple[str, ...]
    places: tuple[tuple[int, int], ...]
    moved_mm: Array
    u_mm: Array
    u_frame_mm: Array
    unknown: tuple[str, ...]
    error: WorkError | None
    rounded_um: Array
    left: tuple[UncorrectedTarget, ...]
    beside_left_mm: Array
    sources: tuple[str, ...]
    overruled: tuple[NamedFrame, ...]
    given_away_mm: Array
    shared: tuple[SharedCorrection, ...] = ()
    changed: frozenset[str] = frozenset()
    notices: tuple[Notice, ...] = ()
    named: frozenset[tuple[str, str]] = frozenset()
    held: bool = False
    start: tuple[float, ...] | None = None
    neutral: tuple[str, ...] = ()
    """Routines that change nothing, as stated by the user."""


@dataclass(frozen=True)
class SolvedProgram:
    """A program with the postures of its targets, as the controller reaches them.

    located (n,): tool and frame. tips (n, 3): points that the program moves, in mm in the frame of the arm's tool.
    q (n, 6): joint angles in rad. nominal (n, 4, 4): poses that the controller computes there. wanted (n, 4, 4): poses
    that the targets mean. offline: joint targets with two different ones. reasons: of targets that stay uncorrected.
    """

    maker: Maker
    texts: ProgramTexts
    parsed: Parsed
    located: list[_Located]
    tips: Array
    q: Array
    nominal: Array
    wanted: Array
    offline: set[int]
    reasons: dict[int, Reason]


def solve_program(
    rig: Rig,
    path: Path,
    frames: Frames = NO_FRAMES,
    scale: Sequence[float] | None = None,
    start: tuple[float, ...] | None = None,
) -> SolvedProgram:
    """Read a program, and determine the postures of its targets. Raises FileError for an invalid program."""
    maker, texts = read_program(path, frames.neutral)
    reader = maker.reader
    parsed = reader.parse(texts)
    arm, targets = controller_arm(rig.robot), parsed.targets
    located = [_located(arm, reader, frames, target) for target in targets]
    inverse_tool = np.linalg.inv(arm.T_flange_tool)
    tips = np.array([(inverse_tool @ place.tool)[:3, 3] for place in located]).reshape(-1, 3)
    q, reasons = _joints_at(arm, parsed, located, scale, start, tips)
    if rig.controller == "unknown":
        of_arm = [k for k, target in enumerate(targets) if not target.joints and reasons.get(k) not in _OF_TEXT]
        reasons |= dict.fromkeys(of_arm, "controller_unknown")
    reasons |= {k: "unused" for k, target in enumerate(targets) if target.file >= texts.own}
    nominal, joints = forward(arm, q), np.array([target.joints for target in targets], dtype=bool)
    wanted = np.where(joints[:, None, None], forward(offline_arm(rig.robot), q), nominal)
    # The correction of these joint targets includes the difference of the controller from the data sheet, that of a
    # pose does not: an arc from one to the other would turn the tool differently.
    offline = {k for k in np.flatnonzero(joints).tolist() if not np.allclose(wanted[k], nominal[k], atol=_SAME_MM)}
    reasons |= {
        step.target: "arc_turns"
        for step in parsed.steps
        if step.arc and step.arc.tangent and offline & step.arc.starts and step.target not in reasons
    }
    return SolvedProgram(maker, texts, parsed, located, tips, q, nominal, wanted, offline, reasons)


def correct_program(
    rig: Rig,
    supported: Sequence[Support],
    path: Path,
    frames: Frames,
    scale: Sequence[float] | None,
    *,
    whole: bool = False,
    start: tuple[float, ...] | None = None,
) -> CorrectedProgram:
    """Return a program with all correctable targets corrected for the effects of a rig.

    whole: hold the program if any target of a move cannot be corrected. start (6,): joint angles in rad at the start of
    the program. Raises FileError for an invalid program.
    """
    program = solve_program(rig, path, frames, scale, start)
    maker, texts, parsed, located = program.maker, program.texts, program.parsed, program.located
    arm, reader, targets = controller_arm(rig.robot), maker.reader, parsed.targets
    q, nominal, wanted, tips, offline = program.q, program.nominal, program.wanted, program.tips, program.offline
    reasons = dict(program.reasons)
    done = corrected(rig, supported, q, [NotCorrected(k, why, "") for k, why in reasons.items()], wanted)
    done = replace(done, T=forward(arm, done.q))
    moved_mm = np.linalg.norm(done.T[:, :3, 3] - nominal[:, :3, 3], axis=1)
    reasons |= {target.place: target.reason for target in done.left}
    flags = _flags_after(arm, targets, q, done)
    reasons |= {k: "changes_flags" for k, values in flags.items() if values is None}
    reasons |= _implausible(arm, q, done, moved_mm)
    if rig.robot.rail is not None:
        reasons |= {k: "external_axes" for k, target in enumerate(targets) if _is_off_zero(target)}
    shared = _shared(rig, supported, parsed, located, Correction(arm, q, done, nominal, tips, reasons))
    because = {k: (move,) for k, (_, move) in shared.refused.items()}
    reasons |= {k: why for k, (why, _) in shared.refused.items()}
    kept = [k for k in range(len(targets)) if k not in reasons and targets[k].of is None]
    changes: list[list[tuple[Number, str]]] = [[] for _ in range(texts.own)]
    for k in kept:
        if not np.array_equal(done.q[k], q[k]):  # Unchanged targets keep their bytes.
            value = done.q[k] if targets[k].joints else _in_program(arm, located[k], done.T[k])
            file = targets[k].file
            changes[file] += _changes(reader, texts.texts[file], targets[k], value, scale)
            changes[file] += _changed_flags(targets[k], flags.get(k))
    new = tuple(map(replaced, texts.texts[: texts.own], changes))
    after = _read_back(reader, parsed, replace(texts, texts=(*new, *texts.texts[texts.own :])))
    left = [
        *parsed.left,
        *(
            UncorrectedTarget(targets[k].file, targets[k].line, targets[k].name, why, because.get(k, ()))
            for k, why in reasons.items()
            if targets[k].of is None and targets[k].file < texts.own
        ),
    ]
    files = dict(zip(texts.names, map(as_bytes, new), strict=False))
    changed = frozenset(name for name, old, text in zip(texts.names, texts.texts, new, strict=False) if old != text)
    return CorrectedProgram(
        path=path,
        maker=maker.name,
        files={name: data for name, data in files.items() if name in changed or not path.is_dir()},
        names=tuple(targets[k].name for k in kept),
        places=tuple((targets[k].file, targets[k].line) for k in kept),
        moved_mm=moved_mm[kept],
        u_mm=done.u_mm[kept],
        u_frame_mm=done.u_frame_mm[kept],
        unknown=tuple(done.unknown[k] for k in kept),
        error=done.error,
        rounded_um=np.array([_off_um(arm, after.targets[k], located[k], scale, done.T[k]) for k in kept]),
        left=tuple(sorted(left, key=lambda target: (target.file, target.line))),
        beside_left_mm=moved_mm[_beside_left(parsed, set(kept))],
        sources=texts.names,
        overruled=tuple(named for named in parsed.sets if _otherwise(named, frames)),
        given_away_mm=shared.kept_mm[kept],
        shared=shared.of(kept),
        changed=changed,
        notices=(*parsed.notices, *_offline_notice(targets, sorted(offline & {*kept}))),
        named=parsed.named,
        held=whole and any(target.reason != "unused" for target in left),
        start=start if _needs_start(parsed) else None,
        neutral=texts.neutral,
    )


_OF_TEXT: tuple[Reason, ...] = ("unknown_tool", "unknown_frame")
"""Reasons that the text of a pose gives, whatever arm computes it."""


_SAME_MM = 1e-3
"""Difference of two poses of a joint target, in mm, below which they are the same."""


def _offline_notice(targets: Sequence[Target], places: Sequence[int]) -> list[Notice]:
    """Return a notice of joint targets that mean a different pose than the controller computes."""
    fact = (
        "joint targets are taken as computed with the data sheet; targets that were taught with the robot or computed "
        "with the controller's own constants should stay as they are"
    )
    return [Notice(targets[k].file, targets[k].line, fact) for k in places[:1]]


def offline_arm(robot: Robot) -> Arm:
    """Return the arm of the data sheet, with which offline programming computes the joint angles of a program.

    If the rig file has the constants of the controller without the name of the arm, it is the arm of the rig file.
    """
    if robot.controller == "constants" and robot.arm and not robot.controller_axes:
        robot = robot.model_copy(update={"axes": load_arm(robot.arm).robot.axes})
    return arm_of(robot)


def _joints_at(
    arm: Arm,
    parsed: Parsed,
    located: Sequence[_Located],
    scale: Sequence[float] | None,
    start: tuple[float, ...] | None,
    tips: Array,
) -> tuple[Array, dict[int, Reason]]:
    """Return the joint angles (n, 6) rad of the controller at the targets, and the reasons for missing ones.

    tips (n, 3): points in mm that the program moves, in the frame of the arm's tool.

    Raises UseError for an unreachable start.
    """
    targets, reasons = parsed.targets, dict[int, Reason]()
    poses, angles = np.full((len(targets), 4, 4), np.nan), np.full((len(targets), 6), np.nan)
    for k, target in enumerate(targets):
        place = _stated_target(target, located[k], scale)
        if isinstance(place, str):
            reasons[k] = place
        elif target.joints:
            angles[k] = place
        else:
            poses[k] = _in_world(arm, located[k], place)
    low, high = arm.limits.T
    if start is not None and ((start < low) | (start > high)).any():
        raise UseError(
            "--start-joints",
            "is beyond the limits of the arm's joints",
            "give angles within the limits",
            code="program.start",
        )
    q, unsolved = solved(arm, targets, poses, angles, parsed.steps, start, tips)
    beyond = ((q < low - 1e-9) | (q > high + 1e-9)).any(axis=1)
    return q, reasons | unsolved | {int(k): "beyond_limits" for k in np.flatnonzero(beyond)}


def _is_off_zero(target: Target) -> bool:
    """Return whether a pose names an external axis that is not at zero."""
    return not target.joints and any(is_moved(coordinate) for _, coordinate in target.external)


def _needs_start(parsed: Parsed) -> bool:
    """Return whether a target's posture depends on the start of the program."""
    first = [(parsed.targets[step.target], step) for step in parsed.steps if AT_BEGIN in step.comes_from]
    return any(not of.joints and not of.near and not (of.flags and step.by_flags) for of, step in first)


def _beside_left(parsed: Parsed, kept: set[int]) -> list[int]:
    """Return the corrected target of each move whose other target is unchanged."""
    base = [k if target.of is None else target.of for k, target in enumerate(parsed.targets)]
    ends_kept = [base[k] for k in parsed.next_to_left]
    for step in parsed.steps:
        ends = [(base[step.target], base[k]) for k in step.comes_from if k not in (None, AT_BEGIN)]
        ends_kept += [
            first if first in kept else second for first, second in ends if (first in kept) != (second in kept)
        ]
    return [k for k in ends_kept if k in kept]


def _otherwise(named: NamedFrame, frames: Frames) -> bool:
    """Return whether the stated numbers of a tool or frame differ from the program."""
    stated = (frames.tools if named.kind == "tool" else frames.frames).get(named.name.lower())
    return stated is not None and not np.allclose(stated.ravel(), named.value, atol=1e-6)


def _shared(
    rig: Rig,
    supported: Sequence[Support],
    parsed: Parsed,
    located: Sequence[_Located],
    correction: Correction,
) -> SharedCorrections:
    """Return the positions that share the correction of a target."""
    targets, arm, done = parsed.targets, correction.arm, correction.done
    shared = SharedCorrections(np.full(len(targets), np.nan))
    commanded = {
        k: _in_world(arm, located[k], _with_offset(target, _in_program(arm, located[target.of], done.T[target.of])))
        for k, target in enumerate(targets)
        if target.of is not None
    }
    add_offsets(shared, correction, targets, commanded, parsed.steps)
    add_vias(shared, correction, rig, supported, targets, parsed.steps)
    return shared


def _with_offset(target: Target, X: Array) -> Array:
    """Return the frame (4, 4) that a move reaches with the offset of a target from X (4, 4)."""
    if target.offset is None:
        return X
    kind, offset = target.offset
    return np.asarray(offset @ X if kind == "frame" else X @ offset)


@dataclass(frozen=True)
class _Located:
    """Tool and frame (4, 4) in mm of a target, or the reason if unknown."""

    tool: Array
    frame: Array
    reason: Reason | None = None


def _located(arm: Arm, reader: ProgramReader, frames: Frames, target: Target) -> _Located:
    # The world frame of the cell differs from the frame of the robot's foot.
    hangs = reader.of_world and arm.T_world_base[2, 2] < 1 - 1e-6
    tool = _stated_frame(target.tool, frames.tools, reader.null_tools)
    frame = _stated_frame(target.frame, frames.frames, () if hangs else reader.null_frames)
    if frame is None or tool is None:
        return _Located(np.eye(4), np.eye(4), "unknown_tool" if tool is None else "unknown_frame")
    return _Located(tool, frame)


def _stated_frame(place: Array | str, named: Mapping[str, Array], null: tuple[str, ...]) -> Array | None:
    if not isinstance(place, str):
        return place
    stated = named.get(place.lower())
    return np.eye(4) if stated is None and place in null else stated


def _stated_target(target: Target, located: _Located, scale: Sequence[float] | None) -> Array | Reason:
    """Return the joint angles (6,) rad or the frame (4, 4) in the numbers of a target, or the reason if missing."""
    if target.form == "pulses" and scale is None:
        return "no_scale"
    values = [number.value for number in target.numbers]
    if not target.joints and not is_frame(target.form, values):
        return "unreachable"
    if not np.isfinite(values).all():
        return "beyond_limits"
    if target.joints:
        return joints_of(target, scale)
    return located.reason or _with_offset(target, frame_of(target.form, values))


def _in_world(arm: Arm, located: _Located, X: Array) -> Array:
    """Return the pose (4, 4) of the rig's tool in the world for the program's tool at X (4, 4) in its frame."""
    T: Array = arm.T_world_base @ located.frame @ X @ np.linalg.inv(located.tool) @ arm.T_flange_tool
    return T


def _in_program(arm: Arm, located: _Located, T: Array) -> Array:
    """Return the program's pose X (4, 4) for a pose T (4, 4) in the world: the inverse of `_in_world`."""
    outer = np.linalg.inv(arm.T_world_base @ located.frame)
    X: Array = outer @ T @ np.linalg.inv(arm.T_flange_tool) @ located.tool
    return X


def _implausible(arm: Arm, q: Array, done: CorrectedTargets, moved_mm: Array) -> dict[int, Reason]:
    """Return the targets with an implausible correction moved_mm (n,), which must not be written, with the reasons."""
    reasons: dict[int, Reason] = {}
    corrected_ones = np.flatnonzero(done.done)
    turned = pose_error(done.T[corrected_ones], forward(arm, q[corrected_ones]))[:, 3:]
    for k, turned_deg in zip(corrected_ones.tolist(), np.degrees(np.linalg.norm(turned, axis=1)), strict=True):
        new = done.q[k]
        joint_deg = float(np.degrees(np.abs(new - q[k]).max()))
        if moved_mm[k] > MOST_MM or turned_deg > _MOST_DEG or joint_deg > _MOST_JOINT_DEG:
            reasons[k] = "too_large"
    return reasons


def _flags_after(
    arm: Arm, targets: Sequence[Target], q: Array, done: CorrectedTargets
) -> dict[int, tuple[int, ...] | None]:
    """Return the new values of flags that do not agree with the corrected angles, None if rig cannot write them.

    The controller obeys the flags: after a change of quadrant or sign, it would reach the angle a full turn away. A
    move with an offset uses the flags of its point.
    """
    changed: dict[int, tuple[int, ...] | None] = {}
    for k in np.flatnonzero(done.done).tolist():
        target, new = targets[k], done.q[k]
        flags = target.flags
        if flags is None or np.array_equal(new, q[k]):
            continue
        of_point = None if target.of is None else changed.get(target.of)
        if of_point is not None:
            flags = replace(flags, values=of_point)
        # Tolerance of the flags: the rounding in the program, or zero if the old angles agreed exactly.
        steps = np.radians([0.0, 1e-5, 1e-4, 1e-3, 2e-2])
        slack = next((float(step) for step in steps if agreeing(arm, q[k][None], flags, float(step))[0]), 0.0)
        if agreeing(arm, new[None], flags, 0.0 if of_point else slack)[0]:
            continue
        changed[k] = None
        if flags.renewed and target.of is None and not target.unknown_offsets:
            renewed = flags.renewed(arm, new)
            values = (*renewed, *flags.values[len(renewed) :])
            if agreeing(arm, new[None], replace(flags, values=values), 0.0)[0]:
                changed[k] = values
    return changed


def _changed_flags(target: Target, values: tuple[int, ...] | None) -> list[tuple[Number, str]]:
    """Return the flags to write for new values."""
    numbers = target.flags.numbers if target.flags and values else ()
    return [(number, str(value)) for number, value in zip(numbers, values or (), strict=False) if number.value != value]


def _changes(
    reader: ProgramReader, text: str, target: Target, new: Array, scale: Sequence[float] | None
) -> list[tuple[Number, str]]:
    """Return the changed numbers of a target in a text. new: angles (6,) rad, or a frame (4, 4)."""
    if target.joints:
        values, decimals = joint_numbers(target.form, new, scale), [reader.decimals.turn] * 6
    else:
        values = frame_numbers(target.form, new, np.array([number.value for number in target.numbers]))
        decimals = [reader.decimals.place] * 3 + [reader.decimals.turn] * (len(values) - 3)
    three = zip(target.numbers, values.tolist(), decimals, strict=True)
    return [(number, written(number, text, value, target.form, places)) for number, value, places in three]


def _read_back(reader: ProgramReader, before: Parsed, texts: ProgramTexts) -> Parsed:
    """Parse the new texts, and check that they contain the same targets."""
    after = reader.parse(texts)

    def others(parsed: Parsed) -> tuple[object, ...]:
        return [(target.name, target.file, target.line) for target in parsed.targets], parsed.steps, parsed.left

    if others(after) != others(before):
        raise FileError(
            "the corrected program",
            "cannot be read back as the same program",
            "please report this with the program",
            code="program.read_back",
        )
    return after


def _off_um(arm: Arm, target: Target, located: _Located, scale: Sequence[float] | None, meant: Array) -> float:
    """Return the distance in µm between the written tool position and the intended pose `meant` (4, 4)."""
    if target.joints:
        written_pose = forward(arm, joints_of(target, scale)[None])[0]
    else:
        written_pose = _in_world(arm, located, frame_of(target.form, [number.value for number in target.numbers]))
    return float(np.linalg.norm(written_pose[:3, 3] - meant[:3, 3])) * 1e3


def frames_of(robot: Robot, tools: Sequence[str], frames: Sequence[str], neutral: Sequence[str] = ()) -> Frames:
    """Parse texts "name=x,y,z,rx,ry,rz" as frames, and lists of routines that change nothing, separated by commas.

    A tool can also be "name=rig", the tool of the rig file, and both can be "name=0". Raises UseError for any other
    text, and for a name with two different frames.
    """
    of_tools = [_parse_named_frame("--tool", text, transform(robot.tool)) for text in tools]
    of_frames = [_parse_named_frame("--frame", text, None) for text in frames]
    stated = _without_contradiction("--tool", of_tools), _without_contradiction("--frame", of_frames)
    routines = tuple(name.strip() for text in neutral for name in text.split(","))
    for name in routines:
        if not re.fullmatch(r"\w[\w -]{0,39}", name):
            raise UseError(
                f"--neutral {name}", "is not the name of a routine", "write NAME or NAME,NAME", code="program.neutral"
            )
    return Frames(*stated, routines)


def _without_contradiction(option: str, named: Sequence[tuple[str, Array]]) -> dict[str, Array]:
    stated: dict[str, Array] = {}
    for name, frame in named:
        if not np.array_equal(stated.setdefault(name, frame), frame):
            raise UseError(
                f"{option} {name}", "is given twice, with different numbers", "give it once", code="program.frame"
            )
    return stated


def doubts_of(frames: Frames, programs: Sequence[CorrectedProgram]) -> list[str]:
    """Return doubts about the frames stated by the user: unused by the programs, or probably in metres."""
    named = {of for program in programs for of in program.named}
    doubts = []
    for kind, stated in (("tool", frames.tools), ("frame", frames.frames)):
        for name, frame in stated.items():
            if programs and (kind, name) not in named:
                doubts.append(
                    f"--{kind} {name}: the programs contain no move that certainly uses a {kind} of that name"
                )
            if 0 < (away_mm := float(np.linalg.norm(frame[:3, 3]))) < _NEAREST_MM:
                doubts.append(
                    f"--{kind} {name}: a distance of only {away_mm:.3g} mm; lengths are in mm; in metres "
                    f"the distance would be {1e3 * away_mm:.4g} mm"
                )
    return doubts


def _parse_named_frame(option: str, text: str, of_rig: Array | None) -> tuple[str, Array]:
    name, equals, values = (part.strip() for part in text.partition("="))
    if not equals or not name:
        raise UseError(f"{option} {text}", "is not NAME=…", _HOW, code="program.frame")
    if values == "rig" and of_rig is not None:
        return name.lower(), of_rig
    if values == "0":
        return name.lower(), np.eye(4)
    numbers = _six(f"{option} {text}", values, _FARTHEST_MM, _HOW)
    return name.lower(), transform(Pose(xyz_mm=tuple(numbers[:3]), rpy_deg=tuple(numbers[3:])))


def start_of(text: str | None) -> tuple[float, ...] | None:
    """Parse joint angles (6,) rad from "deg,deg,…"; None for None. Raises UseError for other text."""
    how = "give the six joint angles in degrees at the start of the program"
    numbers = () if text is None else _six(f"--start-joints {text}", text, _MOST_TURNED_DEG, how)
    return tuple(np.radians(numbers).tolist()) or None


def _six(argument: str, text: str, limit: float, how: str) -> tuple[float, ...]:
    numbers = numbers_in(text)
    if len(numbers) != 6 or not all(abs(value) < limit for value in numbers):
        raise UseError(argument, "is not six numbers", how, code="program.frame")
    return numbers

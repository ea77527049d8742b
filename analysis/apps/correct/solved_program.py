"""The targets of a user's program with the joint angles at which the controller reaches them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from analysis.apps.correct.postures import UNSTATED, ProgramPostures, solved
from analysis.apps.correct.stated_frames import NO_FRAMES, Frames
from analysis.apps.makers import Maker
from analysis.apps.makers.numbers import frame_of, is_frame, joints_of
from analysis.apps.makers.reading import read_program
from analysis.apps.makers.target import Parsed, ProgramTexts, Target
from analysis.correction.point_origins import PointKind
from analysis.correction.reasons import Reason
from analysis.robot.kinematics.arm import Arm, Array, Mask, arm_of, controller_arm, forward
from rigs.arms import load_arm
from rigs.errors import FileError, UseError
from rigs.rig import Rig
from rigs.schema.robot import Robot

_OF_TEXT: tuple[Reason, ...] = ("unknown_tool", "unknown_frame")
"""Reasons that the text of a pose gives, whatever arm computes it."""
_SAME_MM = 1e-3
"""Difference of two poses of a joint target, in mm, below which they are the same."""


@dataclass(frozen=True)
class Located:
    """Conversion between the pose X of the program's tool in its frame and T of the rig's tool in the world:
    T = outer X inner."""

    outer: Array
    """Frame of the program in the world."""
    inner: Array
    """The rig's tool in the program's tool."""
    reason: Reason | None = None
    """Reason if they are unknown."""

    def in_world(self, X: Array) -> Array:
        return np.asarray(self.outer @ X @ self.inner)

    def in_program(self, T: Array) -> Array:
        return np.asarray(np.linalg.inv(self.outer) @ T @ np.linalg.inv(self.inner))


@dataclass(frozen=True)
class SolvedProgram:
    """A program with the postures of its n targets."""

    maker: Maker
    texts: ProgramTexts
    parsed: Parsed
    arm: Arm
    """The arm in the controller."""
    scale: Sequence[float] | None
    """Counts per degree of the axes, for pulses."""
    located: list[Located]
    tips: Array
    """Points (n, 3) that the program moves, in mm in the frame of the arm's tool."""
    q: Array
    """Joint angles (n, 6) rad."""
    nominal: Array
    """Poses (n, 4, 4) that the controller computes there."""
    wanted: Array
    """Poses (n, 4, 4) that the targets mean."""
    offline: set[int]
    """Joint targets for which these two differ."""
    reasons: dict[int, Reason]
    """Of targets that stay uncorrected."""
    taught: Mask
    """Mask (n,) of points that were taught; the numbers of the others were computed."""
    by_user: frozenset[int] = frozenset()
    """Targets at which only the user states the posture."""

    @property
    def kinds(self) -> tuple[tuple[PointKind, Mask], ...]:
        """Masks (n,) of the taught and of the computed points."""
        return ("taught", self.taught), ("computed", ~self.taught)

    @property
    def targets(self) -> tuple[Target, ...]:
        return self.parsed.targets

    def tip(self, k: int, T: Array) -> Array:
        """Position (3,) mm of the program's tool for a pose T (4, 4) of the arm's tool at target k."""
        return np.asarray((T @ np.append(self.tips[k], 1.0))[:3])


def solve_program(
    rig: Rig,
    path: Path,
    frames: Frames = NO_FRAMES,
    scale: Sequence[float] | None = None,
    stated: ProgramPostures = UNSTATED,
    is_taught: Callable[[str, int, str], bool] = lambda file, line, name: False,
) -> SolvedProgram:
    """Read a program, and determine the postures of its targets.

    is_taught: True for a point (file, line, name) that was taught.
    Raises FileError for an invalid program, and UseError for an unreachable start.
    """
    maker, texts = read_program(path, frames.neutral)
    if why := maker.reader.other_arm(texts, rig.robot):
        remedy = "give the rig file of this arm, or the program without the other files of its backup"
        raise FileError(str(path), why, remedy, code="robot.other")
    texts = replace(texts, machine_unit=rig.length_unit or "mm")
    if maker.reader.shifts_only:
        frames.refuse_turns(maker.files.label)
    parsed, arm = maker.reader.parse(texts), controller_arm(rig.robot)
    targets = parsed.targets
    located = [_located(arm, maker, frames, target) for target in targets]
    tips = np.array([np.linalg.inv(place.inner)[:3, 3] for place in located]).reshape(-1, 3)
    q, reasons, by_user = _joints_at(arm, parsed, located, scale, stated, tips)
    points = [target if target.of is None else targets[target.of] for target in targets]
    taught = np.array([is_taught(texts.names[point.file], point.line, point.name) for point in points], dtype=bool)
    poses = [k for k, target in enumerate(targets) if not target.joints and reasons.get(k) not in _OF_TEXT]
    if rig.controller == "unknown":  # A taught pose needs only differences, which the constants hardly change.
        reasons |= dict.fromkeys([k for k in poses if not taught[k]], "controller_unknown")
    reasons |= {k: "unused" for k, target in enumerate(targets) if target.file >= texts.own}
    nominal, joints = forward(arm, q), np.array([target.joints for target in targets], dtype=bool)
    wanted = np.where((joints & ~taught)[:, None, None], forward(_offline_arm(rig.robot), q), nominal)
    # The correction of these joint targets includes the difference of the controller from the data sheet, that of a
    # pose does not: an arc from one to the other would turn the tool differently.
    offline = {k for k in np.flatnonzero(joints).tolist() if not np.allclose(wanted[k], nominal[k], atol=_SAME_MM)}
    reasons |= {
        step.target: "arc_turns"
        for step in parsed.steps
        if step.arc and step.arc.tangent and offline & step.arc.starts and step.target not in reasons
    }
    return SolvedProgram(
        maker, texts, parsed, arm, scale, located, tips, q, nominal, wanted, offline, reasons, taught, by_user
    )


def _offline_arm(robot: Robot) -> Arm:
    """The arm of the data sheet, with which offline programming computes joint angles, if the rig file names it."""
    if robot.controller == "constants" and robot.arm and not robot.controller_axes:
        robot = robot.model_copy(update={"axes": load_arm(robot.arm).robot.axes})
    return arm_of(robot)


def _located(arm: Arm, maker: Maker, frames: Frames, target: Target) -> Located:
    reader = maker.reader
    # The world frame of the cell differs from the frame of the robot's foot.
    hangs = reader.of_world and arm.T_world_base[2, 2] < 1 - 1e-6
    tool = _stated_frame(target.tool, frames.tools, reader.null_tools)
    frame = _stated_frame(target.frame, frames.frames, () if hangs else reader.null_frames)
    if frame is None or tool is None:
        return Located(arm.T_world_base, arm.T_flange_tool, "unknown_tool" if tool is None else "unknown_frame")
    return Located(arm.T_world_base @ frame, np.linalg.inv(tool) @ arm.T_flange_tool)


def _stated_frame(place: Array | str, named: Mapping[str, Array], null: tuple[str, ...]) -> Array | None:
    if not isinstance(place, str):
        return place
    stated = named.get(place.lower())
    return np.eye(4) if stated is None and place in null else stated


def _joints_at(
    arm: Arm,
    parsed: Parsed,
    located: Sequence[Located],
    scale: Sequence[float] | None,
    stated: ProgramPostures,
    tips: Array,
) -> tuple[Array, dict[int, Reason], frozenset[int]]:
    """Joint angles (n, 6) rad of the controller at the targets, the reasons for missing ones, and the targets at which
    only the user states the posture."""
    targets, reasons = parsed.targets, dict[int, Reason]()
    poses, angles = np.full((len(targets), 4, 4), np.nan), np.full((len(targets), 6), np.nan)
    for k, target in enumerate(targets):
        place = _stated_target(target, located[k], scale)
        if isinstance(place, str):
            reasons[k] = place
        elif target.joints:
            angles[k] = place
        else:
            poses[k] = located[k].in_world(place)
    low, high = arm.limits.T
    if stated.start is not None and ((stated.start < low) | (stated.start > high)).any():
        problem = "is beyond the limits of the arm's joints"
        raise UseError("--start-joints", problem, "give angles within the limits", code="usage")
    q, unsolved, by_user = solved(arm, targets, poses, angles, parsed.steps, stated, tips)
    beyond = ((q < low - 1e-9) | (q > high + 1e-9)).any(axis=1)
    return q, reasons | unsolved | {int(k): "beyond_limits" for k in np.flatnonzero(beyond)}, by_user


def _stated_target(target: Target, located: Located, scale: Sequence[float] | None) -> Array | Reason:
    """Joint angles (6,) rad or frame (4, 4) of a target, or the reason if unknown."""
    if target.form == "pulses" and scale is None:
        return "no_scale"
    values = [number.value for number in target.numbers]
    if not target.joints and not is_frame(target.form, values):
        return "unreachable"
    if not np.isfinite(values).all():
        return "beyond_limits"
    if target.joints:
        return joints_of(target, scale)
    return located.reason or with_offset(target, frame_of(target.form, values))


def with_offset(target: Target, X: Array) -> Array:
    """Frame (4, 4) that a move to X (4, 4) reaches with the offset of a target."""
    if target.offset is None:
        return X
    kind, offset = target.offset
    return np.asarray(offset @ X if kind == "frame" else X @ offset)

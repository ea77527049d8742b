"""Targets of a program or table, with the postures in which the robot reaches them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from analysis.apps.certify.features import Feature
from analysis.apps.certify.target_errors import Work
from analysis.apps.correct.postures import UNSTATED, ProgramPostures
from analysis.apps.correct.solved_program import solve_program
from analysis.apps.correct.stated_frames import Frames, postures_of
from analysis.apps.makers import maker_of_file
from analysis.apps.makers.reading import is_marked
from analysis.apps.makers.tool_paths import straight_path
from analysis.apps.programs.target_path import read_targets
from analysis.correction.reasons import WHY
from analysis.correction.support import supports
from analysis.correction.table_postures import TablePostures, disagreeing, find_postures, stated_posture
from analysis.correction.work import real_model, tool_poses, used_effects
from analysis.robot.kinematics.arm import Array, controller_arm
from analysis.robot.kinematics.newton import newton, newton_in_part
from rigs.errors import FileError, UseError
from rigs.rig import Rig
from rigs.schema.vocabulary import DRIVEN_AXES

_ON_LINE = 9
"""Points between the ends of a line. Chosen: the error of an arm varies over a tenth of its work area."""
_ANY_MM_S = 100.0


@dataclass(frozen=True)
class Listed:
    """The n targets of a program, and the reason for each unknown posture.

    straight: pairs with a straight line between them (None: all). is_corrected: the program contains the corrections by
    rig.
    """

    names: tuple[str, ...]
    lines: tuple[int, ...]
    work: Work
    unknown: dict[int, str]
    straight: frozenset[tuple[int, int]] | None = None
    is_corrected: bool = False
    postures: TablePostures | None = None
    """Postures of a table of poses. `several` has only the targets whose corrections differ."""
    by_near: tuple[int, ...] = ()
    """Rows of the targets of a program at which only the user states the posture."""
    is_open: bool = False
    """True if a statement of the posture would add targets of a program."""


def targets_of(
    path: Path,
    rig: Rig,
    frames: Frames,
    *,
    near: str | None,
    start: str | None,
    load_kg: float | None,
    scale: Sequence[float] | None = None,
) -> Listed:
    """Read the targets to certify, from a robot program or a CSV table.

    near, start: statements about the posture, as on the command line. load_kg: payload,
    None for that of the rig.
    """
    if path.is_dir() or maker_of_file(path):
        listed = _of_program(path, rig, frames, scale, postures_of(rig, near, start))
    else:
        listed = _of_table(path, rig, near, start)
    work = listed.work
    if listed.is_corrected:  # the targets mean the poses that the real arm takes there
        used = used_effects(rig, supports(rig))
        work = replace(work, wanted=tool_poses(real_model(rig, used), np.nan_to_num(work.q)))
    if load_kg is not None:
        work = replace(work, load_kg=np.full(len(listed.names), load_kg))
    return replace(listed, work=work)


def _of_table(path: Path, rig: Rig, near: str | None, start: str | None) -> Listed:
    read, poses, q = read_targets(path, rig)
    unknown: dict[int, str] = {}
    postures: TablePostures | None = None
    if q is not None and (option := "--near" if near else "--start-joints" if start else ""):
        problem, remedy = f"{path.name} has joint angles, which determine the posture", "remove the option"
        raise UseError(option, problem, remedy)
    if q is None and len(rig.robot.axes) == DRIVEN_AXES and rig.robot.rail is None:
        postures = find_postures(rig, poses, stated_posture(rig, near, start))
        q, differ = postures.q, {target.place for target in disagreeing(rig, supports(rig), postures, poses)}
        postures = replace(postures, several={k: each for k, each in postures.several.items() if k in differ})
        unknown = {target.place: target.what for target in postures.unsolved}
    elif q is None:
        problem = "has poses, which do not determine the posture of this arm"
        raise FileError(str(path), problem, "give the joint angles of the targets", code="program.unclear")
    names = read.columns.get("name") or [f"line {line}" for line in read.lines]
    try:
        load_kg = np.array([float(cell or "nan") for cell in read.columns.get("load_kg", [""] * len(q))])
    except ValueError as error:
        raise FileError(str(path), f"load_kg: {error}", "give numbers in kg", code="table.invalid") from None
    work = Work(q, poses, np.vstack([np.full_like(q[:1], np.nan), q[:-1]]), load_kg)
    is_corrected = "corrected" in read.columns
    return Listed(tuple(names), read.lines, work, unknown, is_corrected=is_corrected, postures=postures)


def _of_program(
    path: Path, rig: Rig, frames: Frames, scale: Sequence[float] | None, postures: ProgramPostures
) -> Listed:
    if not rig.takes_programs:
        problem = "programs are read only for arms of six axes without a rail"
        raise FileError(str(path), problem, "give a table of joint angles", code="arm.invalid")
    solved = solve_program(rig, path, frames, scale, postures)
    targets, q, parsed = solved.parsed.targets, solved.q, solved.parsed
    own = [k for k, target in enumerate(targets) if target.of is None and target.file < solved.texts.own]
    row_of = {k: row for row, k in enumerate(own)}
    left = [target for target in parsed.left if target.file < solved.texts.own]
    came_from, count = np.full((len(own), q.shape[1]), np.nan), len(own) + len(left)
    straight = set[tuple[int, int]]()
    for k in own:
        steps = [step for step in parsed.steps if step.target == k]
        sources = {source for step in steps for source in step.comes_from}
        if len(sources) == 1 and (source := next(iter(sources))) is not None and source >= 0:
            came_from[row_of[k]] = q[source]
        lines = [step for step in steps if step.way == "line" and step.arc is None]
        straight |= {(row_of[s], row_of[k]) for step in lines for s in step.comes_from if s in row_of}
    unknown = {row_of[k]: WHY[why] for k, why in solved.reasons.items() if k in row_of}
    unknown |= {len(own) + k: WHY[target.reason] for k, target in enumerate(left)}
    empty = np.full((len(left), *q.shape[1:]), np.nan)
    work = Work(
        np.vstack([q[own], empty]), np.concatenate([solved.wanted[own], np.full((len(left), 4, 4), np.nan)]),
        np.vstack([came_from, empty]), np.full(count, np.nan),
    )  # fmt: skip
    names = (*(targets[k].name for k in own), *(target.name for target in left))
    numbers = (*(targets[k].line for k in own), *(target.line for target in left))
    by_near = tuple(row_of[k] for k in sorted(solved.by_user) if k in row_of)
    is_open = postures == UNSTATED and "no_posture" in solved.reasons.values()
    return Listed(names, numbers, work, unknown, frozenset(straight), is_marked(path), by_near=by_near, is_open=is_open)


def with_lines(rig: Rig, listed: Listed, features: Sequence[Feature]) -> tuple[Listed, list[Feature], list[UseError]]:
    """Replace each straightness of two targets by points of the line; an error for each line that the program does not
    drive.
    """
    errors, drawn = list[UseError](), list[Feature]()
    for feature in features:
        if feature.kind != "straightness" or len(feature.rows) > 2:
            drawn.append(feature)
        elif listed.straight is not None and tuple(feature.rows.tolist()) not in listed.straight:
            problem, remedy = "the program has no straight line between these targets", "choose the ends of a line"
            errors.append(UseError(feature.where, problem, remedy, code="usage"))
        else:
            listed, line = _with_line(rig, listed, feature)
            drawn.append(line)
    return listed, drawn, errors


def _with_line(rig: Rig, listed: Listed, feature: Feature) -> tuple[Listed, Feature]:
    first, last = feature.rows.tolist()
    if first in listed.unknown or last in listed.unknown:
        return listed, feature
    work, arm, unknown = listed.work, controller_arm(rig.robot), dict(listed.unknown)
    shares = np.linspace(0, 1, _ON_LINE + 2)[1:-1]
    poses = straight_path(work.wanted[first], work.wanted[last], _ANY_MM_S, shares).poses
    solve, near, count = newton if arm.axes >= DRIVEN_AXES else newton_in_part, work.q[first], len(work.q)
    between = np.full((_ON_LINE, len(near)), np.nan)
    for k, pose in enumerate(poses):
        found, reached = solve(arm, pose[None], near[None])
        if not reached[0]:
            unknown[count + k] = "the arm cannot follow the line"
            break
        between[k] = near = found[0]
    if listed.postures and {first, last} & set(listed.postures.several):
        unknown[count] = "the postures of its ends are unknown"
    came_from = np.vstack([work.came_from, work.q[first], between[:-1]])
    came_from[last] = between[-1]
    longer = Work(
        np.vstack([work.q, between]), np.concatenate([work.wanted, poses]), came_from,
        np.append(work.load_kg, np.full(_ON_LINE, work.load_kg[last])),
    )  # fmt: skip
    rows = np.array([first, *range(count, count + _ON_LINE), last])
    return replace(listed, work=longer, unknown=unknown), replace(feature, rows=rows)


def programmed_places(listed: Listed) -> Array:
    places = listed.work.wanted[:, :3, 3].copy()
    places[list(listed.unknown)] = np.nan
    return places

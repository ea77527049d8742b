"""Paths: targets in a CSV table, as joint angles or as poses (docs/tables.md). Other columns are kept as text."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pyarrow as pa

from analysis.apps.makers.motion_plan import Comment, MotionPlan
from analysis.apps.makers.reading import MARK
from analysis.apps.programs.compensated import compensated
from analysis.correction.corrected_targets import CorrectedTargets
from analysis.correction.reasons import how_to_state_controller
from analysis.correction.support import ANYWAY, require_usable_model, why_nothing
from analysis.correction.work import posture_limits
from analysis.intake.read import value
from analysis.intake.table_files import MOST_BYTES
from analysis.intake.table_problems import TableFileError, TableProblem
from analysis.robot.kinematics.arm import RAIL_MM, Array, arm_of, forward, roll_pitch_yaw, transforms
from analysis.robot.kinematics.joint_limits import turned_into
from analysis.runs.tables import JOINTS, PLACE, RAIL, TURN, joint_columns
from rigs.errors import FileError
from rigs.files import read_bytes
from rigs.rig import Rig
from rigs.text import as_argument

POSES = (*PLACE, *TURN)
ADDED = ("missed_mm", "left_out_mm", "u_um", "u_frame_um", "covered", "corrected")
"""Columns added to a corrected path: error of the uncorrected arm, error of uncorrected effects, standard uncertainty
including these effects, in the robot's base and with frame and tool taught, whether all joints are within the range of
the runs (yes, no or unknown), and whether the target was corrected."""

AGAINST = "against_verdict"
MOST_TARGETS = 20_000
"""Maximum number of targets. Each has dozens of postures, and ten thousand targets take a minute."""
_LARGEST_IN_M = 10.0
"""Bound in mm: if no coordinate of a table exceeds it, the positions are taken to be in metres. No arm reaches a
tool position that close to its base.
"""
_SLACK = 1e-6
"""Tolerance of a joint limit in rad or m, for postures taught at the limit and rounded."""


@dataclass(frozen=True)
class TargetPath:
    columns: dict[str, list[str]]
    names: tuple[str, ...]
    lines: tuple[int, ...]
    values: Array
    """Values (n, axes or 6) of the columns `names`, in mm and degrees."""

    @property
    def joints(self) -> bool:
        return self.names != POSES

    def angles(self) -> Array:
        """Joint angles (n, axes) rad, followed by the rail position in m, if any."""
        units = [1 / RAIL_MM if name == RAIL else np.radians(1.0) for name in self.names]
        return np.asarray(self.values * units)

    def poses(self) -> Array:
        return transforms(self.values)


def read_path(path: Path, axes: int = 6, *, rail: bool = False) -> TargetPath:
    """Read the targets of an arm, as joint angles if the table contains them, with the rail position.

    Raises FileError for an invalid path or values in a wrong unit, and TableFileError with every bad cell.
    """
    names, rows = _rows(path)
    joints = (*joint_columns(axes), RAIL) if rail else joint_columns(axes)
    required, others = (joints, POSES) if set(joints) <= set(names) else (POSES, joints)
    is_corrected = not {*ADDED, AGAINST}.isdisjoint(names)  # Reported later
    if not is_corrected and set(required) <= set(names) and (both := [name for name in others if name in names]):
        what = f"has {required[0]} … {required[-1]} and {both[0]}: joint angles and poses cannot be combined"
        remedy = f"keep one of both; measured poses calibrate an arm: rig calibrate {as_argument(path)} --arm ARM"
        raise FileError(str(path), what, remedy, code="table.invalid")
    read = _targets(path, names, rows, required, f"give {','.join(joints)}, or {','.join(POSES)}")
    _check_units(read, str(path))
    return read


def read_targets(path: Path, rig: Rig) -> tuple[TargetPath, Array, Array | None]:
    """Targets of a table, their poses (n, 4, 4) in the world and, if given, their joint angles (n, axes) rad."""
    read = read_path(path, len(rig.robot.axes), rail=rig.robot.rail is not None)
    if len(read.lines) > MOST_TARGETS:
        problem = f"has {len(read.lines)} targets, and at most {MOST_TARGETS} are compared"
        raise FileError(str(path), problem, "split the table", code="file.too_large")
    if not read.joints:
        return read, read.poses(), None
    q = read.angles()
    _check_limits(read, q, rig, str(path))
    return read, forward(arm_of(rig.robot), q), q


def _check_units(read: TargetPath, where: str) -> None:
    if not read.joints:
        places = np.abs(read.values[:, : len(PLACE)]).max()
        if 0 < places < _LARGEST_IN_M:
            problem = f"has no coordinate above {places:.4g} mm: the positions look like metres"
            raise FileError(where, problem, "multiply x_mm, y_mm and z_mm by 1000", code="table.unclear")
        return
    joints = np.abs(read.values[:, [name != RAIL for name in read.names]]).max()
    if 0 < joints <= 2 * np.pi:
        problem = f"has no joint angle above {joints:.3g}°: the angles look like radians"
        raise FileError(where, problem, "multiply the joint angles by 57.29578", code="table.unclear")


def _check_limits(read: TargetPath, q: Array, rig: Rig, where: str) -> None:
    limits = posture_limits(rig)
    beyond = np.argwhere((q < limits[:, 0] - _SLACK) | (q > limits[:, 1] + _SLACK))
    if len(beyond):
        row, column = beyond[0].tolist()
        name, units = read.names[column], RAIL_MM if read.names[column] == RAIL else float(np.degrees(1.0))
        low, high = limits[column] * units
        problem = f"{name} {q[row, column] * units:.6g} is beyond the limits {low:.6g} to {high:.6g}"
        turned = turned_into(q, limits)[row, column] if read.names[column] != RAIL else np.inf
        same = f" ({np.degrees(turned):.6g} is the same posture)" if low <= np.degrees(turned) <= high else ""
        remedy = f"correct the angle{same}, or limits_deg in the rig file"
        raise FileError(f"{where}, line {read.lines[row]}", problem, remedy, code="path.impossible")


def read_corrected_path(path: Path) -> tuple[TargetPath, TargetPath]:
    """Read a path written by `rig correct`: joint angles, and the poses computed there by the controller.

    Raises the same errors as `read_path`.
    """
    names, rows = _rows(path)
    remedy = "give the table corrected-….csv from rig correct --path"
    return _targets(path, names, rows, JOINTS, remedy), _targets(path, names, rows, POSES, remedy)


def compensated_plans(
    plans: Sequence[MotionPlan], path: Path, rig: Rig, rig_file: str, *, anyway: bool
) -> list[MotionPlan]:
    """Replace the targets of plans by those of a corrected path.

    Raises FileError if the model or the path must not be used, unless `anyway`, or is invalid.
    """
    require_usable_model(rig, rig_file, anyway=anyway)
    if rig.controller == "unknown":
        problem = "the program has poses, and the constants with which the controller computes poses are unknown"
        raise FileError(rig_file, problem, how_to_state_controller(rig), code="controller.invalid")
    joints, poses = read_corrected_path(path)
    against = AGAINST in joints.columns
    if against and not anyway:
        use = "use the nominal targets, or add --anyway; the programs then contain a warning"
        raise FileError(str(path), f"was {ANYWAY}", use, code="correction.impossible")
    made = compensated(plans, np.radians(joints.values), poses.poses(), joints.lines, str(path))
    remarks = [Comment(f"{MARK}: do not correct twice")]
    remarks += [Comment(ANYWAY)] if against or why_nothing(rig) else []
    return [replace(plan, steps=(*remarks, *plan.steps)) for plan in made]


def _targets(
    path: Path, names: list[str], rows: list[tuple[int, list[str]]], required: tuple[str, ...], remedy: str
) -> TargetPath:
    missing = [name for name in required if name not in names]
    if missing:
        raise FileError(str(path), f"has no column {', '.join(missing)}", remedy, code="table.invalid")
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise FileError(str(path), f"has two columns {twice}", "rename one of them", code="table.invalid")
    if not rows:
        raise FileError(str(path), "has a header but no rows", "give the targets", code="table.invalid")
    problems = []
    values = np.zeros((len(rows), len(required)))
    for k, (line, row) in enumerate(rows):
        if len(row) != len(names):
            problems.append(TableProblem(line, "", f"has {len(row)} fields, but the header has {len(names)}"))
            continue
        for column, name in enumerate(required):
            try:
                values[k, column] = value(name, row[names.index(name)])
            except ValueError as error:
                problems.append(TableProblem(line, name, str(error)))
    if problems:
        raise TableFileError(str(path), problems)
    columns = {name: [row[place] for _, row in rows] for place, name in enumerate(names)}
    return TargetPath(columns, required, tuple(line for line, _ in rows), values)


def refuse_corrected_path(path: TargetPath, where: str) -> None:
    """Raises FileError for a path with the columns of a corrected one."""
    added = (*ADDED, AGAINST, "u_mm")  # u_mm: in tables of earlier versions
    if column := next((name for name in added if name in path.columns), ""):
        problem, remedy = f"already has a column {column}", "rename the column; or is the path already corrected?"
        raise FileError(where, problem, remedy, code="correction.repeated")


def corrected_columns(path: TargetPath, corrected: CorrectedTargets, against: str = "") -> pa.Table:
    """Table with corrected targets, as joint angles and as poses, and their errors.

    Uncorrected targets are unchanged, and unknown numbers empty. against: verdict against which the path was corrected.
    """
    columns: dict[str, list[str] | list[float]] = dict(path.columns)
    # A program uses both: the joint angles select the posture of a pose.
    rail = RAIL in path.names
    axes = corrected.q.shape[1] - rail
    names = (*joint_columns(axes), *((RAIL,) if rail else ()), *POSES)
    names = names if np.isfinite(corrected.T).any() else names[: -len(POSES)]  # unknown constants of the controller
    q, T = corrected.q, corrected.T
    values = np.hstack([np.degrees(q[:, :axes]), RAIL_MM * q[:, axes:], T[:, :3, 3], np.degrees(roll_pitch_yaw(T))])
    values = values[:, : len(names)]
    values[np.ix_(~corrected.done, np.isin(names, path.names))] = path.values[~corrected.done]
    values = np.round(values, 7) + 0.0  # no -0.0
    columns |= {name: _cells(column) for name, column in zip(names, values.T, strict=True)}
    left_out_mm = np.linalg.norm(corrected.left_out_mm, axis=1)
    added = (corrected.missed_mm, left_out_mm, 1e3 * corrected.u_mm, 1e3 * corrected.u_frame_mm)
    columns |= {name: _cells(np.round(column, 6)) for name, column in zip(ADDED, added, strict=False)}
    inside = "unknown" if corrected.covered is None else np.where(corrected.covered, "yes", "no")
    columns["covered"] = np.where(corrected.done, inside, "no").tolist()
    columns["corrected"] = np.where(corrected.done, "yes", "no").tolist()
    if against:
        columns[AGAINST] = [against] * len(q)
    return pa.table(columns)


def _cells(values: Array) -> list[str] | list[float]:
    cells: list[float] = values.tolist()
    return cells if np.isfinite(values).all() else ["" if np.isnan(number) else repr(number) for number in cells]


def _rows(path: Path) -> tuple[list[str], list[tuple[int, list[str]]]]:
    try:
        text = read_bytes(path, MOST_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError:
        remedy = "save the file as CSV in UTF-8"
        raise FileError(str(path), "is not UTF-8 text", remedy, code="table.invalid") from None
    except OSError as error:
        problem, remedy = error.strerror or str(error), "check the path and the permissions"
        raise FileError(str(path), problem, remedy, code="file.unreadable") from None
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        rows = [(reader.line_num, fields) for fields in reader if fields]
    except csv.Error as error:
        where, problem = f"{path}, line {reader.line_num}", f"cannot be split into fields: {error}"
        raise FileError(where, problem, "check the quotes", code="table.invalid") from None
    if not rows:
        raise FileError(str(path), "is empty", "give a table with a header line", code="table.invalid")
    return [name.strip() for name in rows[0][1]], rows[1:]

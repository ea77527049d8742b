"""Conversion of a mapped table to the columns of docs/tables.md, in degrees, mm and seconds."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa

from analysis.intake.raw_table import RawTable
from analysis.intake.read import value
from analysis.intake.table_map import MAPPED, TO_UNIT, Angles, Lengths, TableMap, TurnColumns
from analysis.intake.table_problems import Problems, TableFileError, TableProblem
from analysis.robot.geometry.iso_cube import ORDER, Cube
from analysis.robot.geometry.pose_setup import best_rigid, in_frame
from analysis.robot.kinematics.arm import Array, Integers
from analysis.runs.tables import (
    CONTROLLER_PLACE,
    CONTROLLER_TURN,
    COUNTS,
    PLACE,
    SOCKET,
    TURN,
    WORDS,
    format_of,
    joint_columns,
)
from daq.store.chunk import table_schema
from rigs.errors import FileError, UseError
from rigs.schema.vocabulary import Direction, TestName

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation


_UNIT_WITHIN = 0.01
"""Tolerance for quaternions and matrices: rounding of digits only."""
Columns = dict[str, pa.Array | pa.ChunkedArray]


@dataclass(frozen=True)
class MappedPoses:
    """Poses read with a map: joints (n, k) rad, places (n, 3), and orientations."""

    q: Array
    xyz_mm: Array
    turn: Rotation | None
    commanded: Array | None
    controller_mm: Array | None = None
    controller_turn: Rotation | None = None


def poses_of(raw: RawTable, table_map: TableMap) -> MappedPoses:
    problems = Problems()
    if table_map.joints is None or table_map.place is None:
        problem = f"lacks {'joints' if table_map.joints is None else 'place'}, which every pose needs"
        raise FileError("the map", problem, "add the columns and the unit", code="file.invalid")
    q = radians(raw, table_map.joints, problems)
    commanded = radians(raw, table_map.commanded, problems) if table_map.commanded else None
    xyz = _millimetres(raw, table_map.place, problems)
    if residual := table_map.residual:
        sign = 1.0 if residual.meaning == "measured - target" else -1.0
        xyz = xyz + sign * _millimetres(raw, residual, problems)
    turn = turn_of(raw, table_map.turn, problems) if table_map.turn else None
    controller = _millimetres(raw, table_map.controller, problems) if table_map.controller else None
    controller_turn = turn_of(raw, table_map.controller_turn, problems) if table_map.controller_turn else None
    if table_map.place.mirror:
        mirror = np.diag([-1.0 if letter == table_map.place.mirror else 1.0 for letter in "xyz"])
        xyz, turn = xyz @ mirror, None if turn is None else turn.from_matrix(mirror @ turn.as_matrix() @ mirror)
    problems.refuse(raw.where)
    if table_map.sees == "from the tool":
        if turn is None:
            problem, remedy = "has `sees: from the tool` but no `turn`", "add the turn, or write `sees: the tool`"
            raise FileError("the map", problem, remedy, code="file.invalid")
        turn = turn.inv()
        xyz = -turn.apply(xyz)
    return MappedPoses(q, xyz, turn, commanded, controller, controller_turn)


def turn_of(raw: RawTable, turn: TurnColumns, problems: Problems) -> Rotation:
    """Orientations of a table; invalid ones become problems."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import, needed here only

    values = raw.numbers(turn.columns, problems)
    none = {"quaternion": np.eye(4)[3], "matrix": np.eye(3).ravel()}.get(turn.form, np.zeros(3))
    values[~np.isfinite(values).all(axis=1)] = none  # bad cells are already reported
    off = np.zeros(len(values))
    if turn.form == "quaternion":
        off = np.abs(np.linalg.norm(values, axis=1) - 1)
    elif turn.form == "matrix":
        R = values.reshape(-1, 3, 3)
        off = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
        off[np.linalg.det(R) < 0] = np.inf
    for row in np.flatnonzero(off > _UNIT_WITHIN).tolist():
        problem = f"is no turn as {turn.form}: the deviation is {off[row]:.2g}"
        problems.add([TableProblem(int(raw.lines[row]), turn.columns[0], problem)])
    values[off > _UNIT_WITHIN] = none
    if turn.form == "quaternion":
        return Rotation.from_quat(values)
    if turn.form == "matrix":
        return Rotation.from_matrix(values.reshape(-1, 3, 3))
    degrees = turn.unit == "deg"
    if turn.form == "rotation vector":
        return Rotation.from_rotvec(values, degrees=degrees)
    way, order = turn.form.split()
    return Rotation.from_euler(order.upper() if way == "moving" else order, values, degrees=degrees)


def radians(raw: RawTable, angles: Angles, problems: Problems | None = None) -> Array:
    values = np.radians(raw.numbers(angles.columns, problems) * angles.factors)
    backwards = np.isin(np.arange(1, len(angles.columns) + 1), angles.reversed)
    return values * np.where(backwards, -1.0, 1.0) + np.radians(angles.zeros_deg or 0.0)


def _millimetres(raw: RawTable, lengths: Lengths, problems: Problems) -> Array:
    return raw.numbers(lengths.columns, problems) * lengths.factors


def table_by(
    raw: RawTable, table_map: TableMap, test: TestName, axes: int, direction: Direction | None = None
) -> pa.Table:
    """Table of a test in the format of docs/tables.md, with all other columns of the file as text."""
    if test == MAPPED:
        named = _pose_columns(raw, table_map, axes)
    else:
        named = _mapped_columns(raw, table_map, test, axes, direction)
    used, known = set(table_map.used()), set(format_of(test).layout(axes).known_columns)
    for name in (name for name in raw.names if name not in used):
        if test == MAPPED and name in known and name not in named:
            named[name] = pa.array(raw.numbers([name])[:, 0])
        else:
            named[name if name not in named else f"{name} (file)"] = raw.cells[name]
    types = {name: str(column.type) for name, column in named.items()}
    return pa.table(named, schema=table_schema(types))  # type: ignore[arg-type]


def _pose_columns(raw: RawTable, table_map: TableMap, axes: int) -> Columns:
    for part in filter(None, (table_map.joints, table_map.commanded)):
        if len(part.columns) != axes:
            fact = f"names {len(part.columns)} columns of joints, but the arm of the rig file has {axes} axes"
            remedy = "name a column for each axis, in order, or give the rig file of that arm"
            raise FileError("the map", fact, remedy, code="file.invalid")
    poses = poses_of(raw, table_map)
    turn, controller_turn = (
        None if turn is None else turn.as_euler("xyz", degrees=True) for turn in (poses.turn, poses.controller_turn)
    )
    commanded = None if poses.commanded is None else np.degrees(poses.commanded)
    parts = [
        (joint_columns(axes), np.degrees(poses.q)),
        (PLACE, poses.xyz_mm),
        (TURN, turn),
        (CONTROLLER_TURN, controller_turn),
        (CONTROLLER_PLACE, poses.controller_mm),
        ([f"q{axis}_commanded_deg" for axis in range(1, axes + 1)], commanded),
    ]
    return {
        name: pa.array(column)
        for names, values in parts
        if values is not None
        for name, column in zip(names, values.T, strict=True)
    }


def _mapped_columns(
    raw: RawTable, table_map: TableMap, test: TestName, axes: int, direction: Direction | None
) -> Columns:
    layout, stated = format_of(test).layout(axes), table_map.columns
    driven = any(name in layout.required for name in joint_columns(1))
    joints = list(joint_columns(len(table_map.joints.columns))) if table_map.joints else []
    missing = [name for name in layout.required if name not in {*stated, *joints, *table_map.constants}]
    missing = [name for name in missing if not (direction and name == "direction")]
    if missing or (driven and table_map.joints is None):
        problem = f"does not name a column for {', '.join(missing[:6]) or 'the joints'}, which a {test} table needs"
        remedy = "add columns: {NAME: {column: COLUMN OF THE FILE, unit: UNIT}}"
        raise FileError("the map", problem, remedy, code="file.invalid")
    if unknown := [name for name in (*stated, *table_map.constants) if name not in layout.known_columns]:
        problem = f"names {unknown[0]}, which is not a column of a {test} table"
        raise UseError("the map", problem, f"choose from {', '.join(layout.known_columns)}", code="file.invalid")
    problems = Problems()
    angles = np.degrees(radians(raw, table_map.joints, problems)) if table_map.joints else np.empty((0, 0))
    named: Columns = {}
    for name in layout.known_columns:
        if name in joints:
            named[name] = pa.array(angles[:, joints.index(name)])
        elif name in stated:
            named[name] = _column(raw, name, stated[name].column, stated[name].unit, problems)
        elif name in table_map.constants:
            named[name] = pa.repeat(table_map.constants[name], len(raw.lines))
        elif name == "direction" and direction:
            named[name] = pa.repeat(direction, len(raw.lines))
    problems.refuse(raw.where)
    return named


def _column(raw: RawTable, name: str, column: str, unit: str | None, problems: Problems) -> pa.Array:
    """A column by the standard name: a number in the standard unit, a count, or a word."""
    if name not in (*WORDS, *COUNTS, SOCKET):
        factors = TO_UNIT[name.rpartition("_")[2]]
        if unit and unit not in factors:
            problem, remedy = f"states the unit {unit} for {name}", f"give one of {', '.join(factors)}"
            raise FileError("the map", problem, remedy, code="table.unclear")
        return pa.array(raw.numbers([column], problems)[:, 0] * (factors[unit] if unit else 1.0))
    if column not in raw.names:
        raise FileError(
            raw.where, f"has no column {column!r}", f"it has {', '.join(raw.names[:30])}", code="table.invalid"
        )
    values: list[object] = []
    for line, text in zip(raw.lines.tolist(), raw.cells[column].to_pylist(), strict=True):
        try:
            values.append(value(name, text))
        except ValueError as error:
            problems.add([TableProblem(line, column, str(error))])
            values.append(None)
    return pa.array(values, pa.int64() if name in COUNTS else pa.string())


_HEAP = 0.05
"""Radius of a cluster in sides of the cube; poses are sixteen times farther apart."""
_FITS = 0.01
"""Tolerance for the clusters of the cube, as a share of the side."""
_IN_ORDER = 0.6
"""Minimum share of steps between rows in cycle order; each missed stop breaks two steps."""
_MOST_HEAPS = 50


def with_joints(raw: RawTable, place: Lengths, cube: Cube) -> RawTable:
    """Add the joint angles and the pose name of each row to a table of stops at the cube.

    Raises FileError if the rows are not such stops, and TableFileError for rows at none of the poses.
    """
    pose = poses_of_stops(raw.numbers(place.columns) * place.factors, cube)
    if pose is None:
        problem = "lacks columns of joints, and the positions are not stops at the cube in the order P5 P4 P3 P2 P1"
        remedy = "check tests.iso9283 of the rig file and the unit; for other poses add the joint angles (--join)"
        raise FileError(raw.where, problem, remedy, code="table.invalid")
    if (pose == 0).any():
        problem = "this position is not one of the cube's poses"
        lines = raw.lines[pose == 0].tolist()
        raise TableFileError(raw.where, [TableProblem(line, place.columns[0], problem) for line in lines[:20]])
    columns = dict(zip(joint_columns(cube.q.shape[1]), np.degrees(cube.q[pose - 1]).T, strict=True))
    cells = raw.cells
    for name, values in columns.items():
        cells = cells.append_column(name, pa.array([repr(value) for value in values.tolist()]))
    names = (*raw.names, *columns)
    if "pose" not in names:
        cells, names = cells.append_column("pose", pa.array([f"P{number}" for number in pose])), (*names, "pose")
    units = (*raw.units, *[""] * (len(names) - len(raw.units))) if raw.units else raw.units
    return RawTable(raw.where, names, units, cells, raw.lines, decimal_comma=raw.decimal_comma)


def poses_of_stops(xyz_mm: Array, cube: Cube) -> Integers | None:
    """Pose 1 … 5 of each place (n, 3) mm in time order, 0 for another place; None if the order is not the cube's.

    A triggered tracker writes only places, and sometimes misses a stop. Several assignments of the five clusters fit a
    rectangle with a centre; the one in the order of the standard is chosen.
    """
    first: list[Array] = []
    heap = np.zeros(len(xyz_mm), dtype=np.int64)
    for row, place in enumerate(xyz_mm):
        away = np.linalg.norm(np.array(first) - place, axis=1) if first else np.empty(0)
        if len(away) and away.min() < _HEAP * cube.side_mm:
            heap[row] = int(away.argmin())
        elif len(first) <= _MOST_HEAPS:
            heap[row] = len(first)
            first.append(place)
    middles = np.array([xyz_mm[heap == number].mean(axis=0) for number in range(len(first))])
    largest = np.argsort(-np.bincount(heap), kind="stable")[: len(ORDER)]
    if len(largest) < len(ORDER) or len(middles) > _MOST_HEAPS:
        return None
    best, most = None, _IN_ORDER
    for names in permutations(range(1, len(ORDER) + 1)):
        goal = cube.places_mm[np.array(names) - 1]
        T = best_rigid(middles[largest], goal)
        off = in_frame(T, middles[largest]) - goal
        if np.linalg.norm(off, axis=1).max() > _FITS * cube.side_mm:
            continue
        named = np.zeros(len(middles), dtype=np.int64)
        named[largest] = names
        pose = named[heap]
        # The share of steps that lead to the next pose of the cycle
        places = np.argsort(ORDER)[pose[pose > 0] - 1]
        steps = np.diff(places) % len(ORDER) == 1
        share = float(np.mean(steps)) if len(steps) else 0.0
        if share > most:
            best, most = pose, share
    return best

"""Assignment of measured stops to the poses P1 … P5 of the ISO 9283 cube, which gives the joint angles of a table of
places.

A tracker triggered at each stop writes only places and sometimes misses a stop. The rows form five clusters. Several
assignments fit the cube, which is a rectangle with a centre; the assignment that follows the standard order is
selected.
"""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pyarrow as pa

from analysis.intake.cells import TableFileError, TableProblem
from analysis.intake.raw_table import RawTable
from analysis.intake.table_map import Lengths
from analysis.robot.geometry.iso_cube import ORDER, Cube
from analysis.robot.geometry.pose_setup import best_rigid, in_frame
from analysis.robot.kinematics.arm import Array, Integers
from analysis.runs.table_layout import joint_columns
from rigs.errors import FileError

_HEAP = 0.05
"""Radius of a cluster in sides of the cube. Arms stop more accurately, and poses are sixteen times farther apart."""
_FITS = 0.01
"""Tolerance for the clusters of the cube, as a share of the side."""
_IN_ORDER = 0.6
"""Minimum share of steps between rows in cycle order; each missed stop breaks two steps."""
_MOST_HEAPS = 50


def with_joints(raw: RawTable, place: Lengths, cube: Cube) -> RawTable:
    """Table with the joint angles and the pose name of each row added.

    Raises FileError if the rows are not stops of the cube, and TableFileError for rows at none of the poses.
    """
    xyz_mm = raw.numbers(place.columns) * place.factors
    pose = poses_of_stops(xyz_mm, cube)
    if pose is None:
        problem = "lacks columns of joints, and the positions are not stops at the cube in the order P5 P4 P3 P2 P1"
        remedy = "check tests.iso9283 of the rig file and the unit; for other poses add the joint angles (--join)"
        raise FileError(raw.where, problem, remedy, code="cube.unknown_stop")
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
    """Pose 1 … 5 of each place (n, 3) mm in time order, 0 for a different place; None if the order is not
    that of the cube.
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
        visited = pose[pose > 0]
        follows = {pose_number: ORDER[(place + 1) % len(ORDER)] for place, pose_number in enumerate(ORDER)}
        steps = [
            follows[before] == after for before, after in zip(visited[:-1].tolist(), visited[1:].tolist(), strict=True)
        ]
        share = float(np.mean(steps)) if steps else 0.0
        if share > most:
            best, most = pose, share
    return best

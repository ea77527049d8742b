"""Table of touches of two arms: joint angles of both, and the touched socket."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analysis.intake.raw_table import RawTable, layout_of, read_raw, text_of
from analysis.intake.table_files import read_text
from analysis.robot.kinematics.arm import Array, Integers, Mask
from analysis.runs.tables import joint_columns, second_joint_columns
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.vocabulary import MOST_AXES

FEWEST = 12
"""36 gaps for the 12 numbers of transform, ball and socket, and the largest constants."""
_LARGEST_DEG = 1000.0
"""No controller counts beyond three turns."""
_FULL_TURN = 2 * np.pi
"""Angles within it are assumed to be in radians: in degrees the joints would hardly have moved."""
_MOVED_RAD = float(np.radians(5.0))
"""Far above noise, far below any useful plan."""


@dataclass(frozen=True)
class PairTable:
    """Angles q (n, axes) of the first arm, and p of the second, NaN if the socket is fixed. row (n,): in the file, from
    1.
    """

    q: Array
    p: Array
    socket: NDArray[np.str_]
    row: Integers

    @property
    def is_mounted(self) -> Mask:
        return np.asarray(~np.isnan(self.p).any(axis=1), dtype=bool)

    def rows(self, keep: Mask) -> PairTable:
        return PairTable(*(getattr(self, field.name)[keep] for field in fields(self)))


def read_pair_table(path: Path, first: Rig, second: Rig) -> PairTable:
    where = str(path)
    lines, text_layout = text_of(read_text(path), where)
    raw = read_raw(lines, layout_of(lines, text_layout.encoding, where), where)
    q = _angles(raw, joint_columns(MOST_AXES), len(first.robot.axes), first.name, may_be_empty=False)
    p = _angles(raw, second_joint_columns(MOST_AXES), len(second.robot.axes), second.name, may_be_empty=True)
    rows = np.arange(1, len(q) + 1)
    table = PairTable(np.radians(q), np.radians(p), _sockets(raw, first, len(q)), rows)
    check_pair_table(table, where, first.name, second.name)
    return table


def check_pair_table(table: PairTable, where: str, first: str, second: str) -> None:
    """Refuse too few touches, an arm that stood still, or a socket both fixed and mounted."""
    mounted = table.is_mounted
    twofold = sorted(set(table.socket[mounted]) & set(table.socket[~mounted]))
    if twofold:
        problem = f"socket {twofold[0]} is on the second arm in some rows and fixed in others"
        raise FileError(where, problem, "give each fixed socket a different name", code="pair.invalid")
    if mounted.sum() < FEWEST:
        problem = f"has {mounted.sum()} touches with both arms; at least {FEWEST} are needed"
        raise FileError(
            where, problem, "touch in 40 or more postures of both arms (rig pair … --plan 40)", code="readings.too_few"
        )
    for joints, names, arm in ((table.q, joint_columns, first), (table.p[mounted], second_joint_columns, second)):
        if _is_still(joints):
            columns = names(joints.shape[1])
            problem = f"{columns[0]} … {columns[-1]} are the same in all rows: {arm} stood still"
            raise FileError(
                where,
                problem,
                "move both arms between touches; for a fixed socket use rig diagnose",
                code="pair.invalid",
            )


def _is_still(joints: Array) -> bool:
    """No joint (n, axes) moved, in rad or in degrees misread as rad."""
    moved = joints[~np.isnan(joints).any(axis=1)]
    return not len(moved) or bool(np.ptp(moved, axis=0).max() < _MOVED_RAD)


def _angles(raw: RawTable, names: tuple[str, ...], axes: int, arm: str, *, may_be_empty: bool) -> Array:
    """Angles (n, axes) in degrees; NaN for empty rows if these are permitted."""
    present = [name for name in names if name in raw.names]
    needed = names[:axes]
    if missing := [name for name in needed if name not in present]:
        problem = f"lacks the columns {missing[0]} … {missing[-1]}" if len(missing) > 1 else f"lacks {missing[0]}"
        raise FileError(
            raw.where,
            f"{problem} of {arm} ({axes} axes)",
            "add the joint angles in degrees",
            code="table.invalid",
        )
    if len(present) > axes:
        problem = f"has {present[-1]}, but {arm} has {axes} axes"
        raise FileError(
            raw.where, problem, "give first the rig file of the arm whose joints are q1_deg …", code="table.unclear"
        )
    angles = np.stack([_column(raw, name, may_be_empty=may_be_empty) for name in needed], axis=1)
    numbers = angles[~np.isnan(angles)]
    if len(numbers) and np.abs(numbers).max() <= _FULL_TURN and not _is_still(angles):
        problem = f"has {needed[0]} … {needed[-1]} within ±6.3, which look like radians"
        raise FileError(raw.where, problem, "multiply them by 57.29578", code="table.unclear")
    partly = np.isnan(angles).any(axis=1) & ~np.isnan(angles).all(axis=1)
    if partly.any():
        line = int(raw.lines[np.argmax(partly)])
        problem = f"line {line}: some of {needed[0]} … {needed[-1]} are empty"
        raise FileError(
            raw.where, problem, "give all of them, or none if the socket is fixed in the cell", code="pair.invalid"
        )
    return angles


def _column(raw: RawTable, name: str, *, may_be_empty: bool) -> Array:
    cells = [cell.strip() for cell in raw.cells[name].to_pylist()]
    values = np.empty(len(cells))
    for k, cell in enumerate(cells):
        try:
            values[k] = float(cell.replace(",", ".") if raw.decimal_comma else cell) if cell else np.nan
        except ValueError:
            values[k] = np.inf
        if (not cell and not may_be_empty) or (cell and not abs(values[k]) <= _LARGEST_DEG):
            problem = f"line {raw.lines[k]}: {name} is {cell!r}, which is not a joint angle in degrees"
            raise FileError(raw.where, problem, "correct the cell, or remove the row", code="table.invalid")
    return values


def _sockets(raw: RawTable, first: Rig, count: int) -> NDArray[np.str_]:
    if raw.socket_column:
        return np.array([cell.strip() for cell in raw.cells[raw.socket_column].to_pylist()], dtype=np.str_)
    declared = first.tests.touch.sockets if first.tests.touch else ()
    return np.full(count, declared[0] if declared else "A")

"""Refusal of data given twice: a copy would pass for a repeat without noise, an unmoved robot, or an independent test.

Every command and function that compares runs calls `refuse_repeated`. Two runs are the same data if their readings have
the same digest, as copied directories and tables imported twice, or if their rows agree in any order.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from analysis.robot.kinematics.arm import Array
from analysis.runs.loading import Measured
from analysis.runs.tables import PoseTable, TouchTable
from rigs.errors import FileError

USED, HELD_OUT, ELSEWHERE = "used to fit", "held out", "unseen"
REFERENCE, NEW = "reference", "new"
_REMEDY = "give each recording once"
_COPIED = 0.5
"""Share of equal rows from which a table of poses is a copy. Chosen: no two visits agree in posture and position to the
last digit.
"""
_FEWEST_TOUCHES = 3
"""Smallest number of equal touches that is a copy. A touch has only the joints, which may agree by chance."""


def refuse_repeated(groups: Mapping[str, Sequence[Measured]]) -> None:
    """Raise FileError if two runs contain the same data.

    groups: runs by their role, which the message states: `USED`, `HELD_OUT`, `ELSEWHERE`, or `REFERENCE` and `NEW`.
    """
    given = [(run, role) for role, runs in groups.items() for run in runs]
    refuse_copies((run.path, run.run.readings_sha256, role) for run, role in given)
    refuse_copied_rows(given)


def refuse_copies(runs: Iterable[tuple[Path, str, str]]) -> None:
    """Raise FileError if two runs have equal readings. runs: path, digest of the readings, and role of each."""
    by_digest: dict[str, tuple[Path, str]] = {}
    for path, digest, role in runs:
        if first := by_digest.get(digest):
            raise _repeated(path, role, *first)
        by_digest[digest] = path, role


def refuse_copied_rows(given: Sequence[tuple[Measured, str]]) -> None:
    """Raise FileError if two tables share most poses, or all touches, in any order and any turn of the joints, or if
    many poses of a run are copies: a copy shows no repeatability. given: runs with their roles.
    """
    seen: list[tuple[Measured, str, set[bytes]]] = []
    for run, role in given:
        if not isinstance(run.table, PoseTable | TouchTable):
            continue
        is_pose = isinstance(run.table, PoseTable)
        rows, count = _rows(run.table), len(run.table.q)
        if is_pose and count - len(rows) > _COPIED * len(rows):
            problem = f"contains {count - len(rows)} of its {count} rows twice, to the last digit"
            remedy = "give each pose once; visit a target again to show its repeatability"
            raise FileError(run.run.manifest.name, problem, remedy, code="run.copied")
        for first, its_role, earlier in seen:
            common, fewer = len(rows & earlier), min(len(rows), len(earlier))
            if common > _COPIED * fewer if is_pose else common == fewer >= _FEWEST_TOUCHES:
                raise _repeated(run.path, role, first.path, its_role)
        seen.append((run, role, rows))


def _rows(table: PoseTable | TouchTable) -> set[bytes]:
    """Rows of a table, the same for any turn of the joints and for 0 and -0."""
    parts: list[Array] = [np.cos(table.q), np.sin(table.q)]
    if isinstance(table, PoseTable):
        parts.append(table.xyz_mm)
    rows = [row.tobytes() for row in np.hstack(parts).round(6) + 0.0]
    if isinstance(table, TouchTable):
        return {str(socket).encode() + row for socket, row in zip(table.socket, rows, strict=True)}
    return set(rows)


def _repeated(path: Path, role: str, first: Path, its_role: str) -> FileError:
    """Error about a run with the data of an earlier one."""
    roles = "" if role == its_role else f": {role} here, {its_role} there"
    same = "is given twice" if _is_same(path, first) else f"contains the same readings as {first}"
    return FileError(str(path), f"{same}{roles}", _REMEDY, code="run.copied")


def _is_same(path: Path, other: Path) -> bool:
    try:
        return path.resolve() == other.resolve()
    except OSError:
        return path == other

"""What a cell alone does not show: time that runs back, a second direction, jumps of joints, unknown targets."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from analysis.files.cells import Columns, TableProblem
from analysis.kinematics.arm import Array
from analysis.measures.stops import target_count
from analysis.traces.kind import kind_named
from analysis.traces.table_layout import JOINTS, SOCKET, TIME_U, joint_columns
from rigs.rig import Rig
from rigs.schema.vocabulary import DRIVEN_AXES, Direction, TestName

_SPEED_FACTOR = 2.0
"""A joint that moves faster than this many times its rated speed …"""
_ROUNDING_DEG = 2.0
"""… and by more than this has jumped: times are rounded, and speeds in rig files are nominal. …"""
_LARGEST_STEP_DEG = 120.0
"""… And so has one that moves further than this between neighbouring samples, however slow they are."""


def check_sequence(
    columns: Columns, lines: np.ndarray, test: TestName, rig: Rig, direction: Direction | None
) -> Iterator[TableProblem]:
    """Mistakes between rows, and beside the rig; cells that are null are left out, they are mistakes already.

    lines: the number of each row's line (n,).
    """
    columns_of_test = kind_named(test).layout().known
    if "t_s" in columns_of_test and "t_s" in columns:
        t_s = columns["t_s"].to_numpy()
        timed = np.flatnonzero(np.isfinite(t_s))
        for k in np.flatnonzero(np.diff(t_s[timed]) <= 0):
            fact = f"time does not increase: {t_s[timed[k + 1]]:g} after {t_s[timed[k]]:g}"
            yield TableProblem(int(lines[timed[k + 1]]), "t_s", fact)
    for name in (name for name in TIME_U if name in columns_of_test and name in columns):
        for k in np.flatnonzero(columns[name].to_numpy() < 0):
            yield TableProblem(int(lines[k]), name, "an uncertainty is not below zero")
    if "target" in columns_of_test and rig.tests.hemisphere:
        target = columns["target"].to_numpy()
        count = target_count(rig.tests.hemisphere)
        for k in np.flatnonzero(target > count):
            fact = f"{target[k]:.0f} is not one of the {count} targets of the rig's hemisphere"
            yield TableProblem(int(lines[k]), "target", fact)
    # A joint more than the arm has: of touches, and of arms of few axes, whose gripper is easily taken for one.
    axes = len(rig.robot.axes)
    further = joint_columns(axes + 1)[-1]
    if further in columns and (SOCKET in columns_of_test or axes < DRIVEN_AXES):
        fact = f"the table has {axes + 1} joints, and the arm of the rig file {axes}"
        yield TableProblem(1, further, fact + ("; rename the column of a gripper" if axes < DRIVEN_AXES else ""))
    if SOCKET in columns_of_test:
        declared = rig.tests.touch.sockets if rig.tests.touch else ()
        for line, socket in zip(lines.tolist(), columns[SOCKET].to_pylist(), strict=True):
            if declared and socket not in declared:
                fact = f"{socket!r} is no socket of the rig file: {', '.join(declared)}"
                yield TableProblem(int(line), SOCKET, fact)
    if "direction" in columns_of_test:
        yield from _one_direction(columns["direction"], lines, direction)
        t_s = columns["t_s"].to_numpy()
        for axis, name in zip(rig.robot.axes, JOINTS, strict=True):
            yield from _jumps(name, t_s, columns[name].to_numpy(), lines, axis.speed_deg_s)


def _one_direction(words: pa.ChunkedArray, lines: np.ndarray, direction: Direction | None) -> Iterator[TableProblem]:
    named = pc.unique(words.drop_null()).to_pylist()
    if direction and named == ["acw" if direction == "cw" else "cw"]:
        yield TableProblem(int(lines[0]), "direction", f"the table says {named[0]}; leave --direction out")
    elif len(named) > 1:
        fact = f"{named[1]} after {named[0]}: a file may hold one direction only; split it here"
        yield TableProblem(int(lines[pc.index(words, named[1]).as_py()]), "direction", fact)


def _jumps(name: str, t_s: Array, q_deg: Array, lines: np.ndarray, speed_deg_s: float) -> Iterator[TableProblem]:
    finite = np.flatnonzero(np.isfinite(t_s) & np.isfinite(q_deg))
    step, gap_s = np.diff(q_deg[finite]), np.diff(t_s[finite])
    reachable = _SPEED_FACTOR * speed_deg_s * np.maximum(gap_s, 0.0) + _ROUNDING_DEG
    jump = (np.abs(step) > np.minimum(reachable, _LARGEST_STEP_DEG)) & (gap_s > 0)
    came = -2
    for k in np.flatnonzero(jump).tolist():
        # A single bad row jumps there and back: it is named, the good one after it is not.
        if came == k - 1 and step[k] * step[k - 1] < 0:
            came = -2
            continue
        came = k
        fact = f"jumps by {step[k]:.4g}° in {gap_s[k]:.3g} s"
        if abs(abs(step[k]) - 360) < 20:
            fact += ": a full turn is missing; unwrap the angle"
        yield TableProblem(int(lines[finite[k + 1]]), name, fact)

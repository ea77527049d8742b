"""What a cell alone does not show: time that runs back, a second direction, jumps of joints, unknown targets."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from analysis.files.cells import Value
from analysis.files.table_problems import TableProblem
from analysis.kinematics.arm import Array
from analysis.measures.rig_agreement import target_count
from analysis.traces.table_layout import JOINTS, LAYOUTS
from rigs.rig import Rig
from rigs.schema.vocabulary import Direction, TestName

_SPEED_FACTOR = 2.0
"""A joint that moves faster than this many times its rated speed …"""
_ROUNDING_DEG = 2.0
"""… and by more than this has jumped: times are rounded, and speeds in rig files are nominal. …"""
_LARGEST_STEP_DEG = 120.0
"""… And so has one that moves further than this between neighbouring samples, however slow they are."""
Columns = Mapping[str, Sequence[Value | None]]


def check_sequence(
    columns: Columns, lines: list[int], test: TestName, rig: Rig, direction: Direction | None
) -> list[TableProblem]:
    """Mistakes between rows, and beside the rig; cells that are None are left out, they are mistakes already."""
    problems: list[TableProblem] = []
    known = LAYOUTS[test].known
    if "t_s" in known and "t_s" in columns:
        problems += _time(_numbers(columns["t_s"]), lines)
    if "target" in known and rig.tests.hemisphere:
        problems += _targets(columns["target"], lines, target_count(rig.tests.hemisphere))
    if "direction" in known:
        problems += _one_direction(columns["direction"], lines, direction)
        t_s = _numbers(columns["t_s"])
        for axis, name in zip(rig.robot.axes, JOINTS, strict=True):
            problems += _jumps(name, t_s, _numbers(columns[name]), lines, axis.speed_deg_s)
    return problems


def _numbers(values: Sequence[Value | None]) -> Array:
    return np.array([np.nan if value is None else value for value in values], dtype=float)


def _time(t_s: Array, lines: list[int]) -> list[TableProblem]:
    there = np.flatnonzero(np.isfinite(t_s))
    back = np.flatnonzero(np.diff(t_s[there]) <= 0)
    return [
        TableProblem(
            lines[there[k + 1]], "t_s", f"time does not increase: {t_s[there[k + 1]]:g} after {t_s[there[k]]:g}"
        )
        for k in back
    ]


def _targets(values: Sequence[Value | None], lines: list[int], count: int) -> list[TableProblem]:
    return [
        TableProblem(line, "target", f"{value} is not one of the {count} targets of the rig's hemisphere")
        for line, value in zip(lines, values, strict=True)
        if isinstance(value, int) and value > count
    ]


def _one_direction(values: Sequence[Value | None], lines: list[int], direction: Direction | None) -> list[TableProblem]:
    named = Counter(value for value in values if value is not None)
    if not named:
        return []
    if direction and set(named) == {"acw" if direction == "cw" else "cw"}:
        return [TableProblem(lines[0], "direction", f"the table says {values[0]}; leave --direction out")]
    first = next(value for value in values if value is not None)
    other = [k for k, value in enumerate(values) if value not in (first, None)]
    if not other:
        return []
    message = f"{values[other[0]]} after {first}: a file may hold one direction only; split it here"
    return [TableProblem(lines[other[0]], "direction", message)]


def _jumps(name: str, t_s: Array, q_deg: Array, lines: list[int], speed_deg_s: float) -> list[TableProblem]:
    there = np.flatnonzero(np.isfinite(t_s) & np.isfinite(q_deg))
    step, gap_s = np.diff(q_deg[there]), np.diff(t_s[there])
    reachable = _SPEED_FACTOR * speed_deg_s * np.maximum(gap_s, 0.0) + _ROUNDING_DEG
    jump = (np.abs(step) > np.minimum(reachable, _LARGEST_STEP_DEG)) & (gap_s > 0)
    problems, came = [], -2
    for k in np.flatnonzero(jump).tolist():
        # A single bad row jumps there and back: it is named, the good one after it is not.
        if came == k - 1 and step[k] * step[k - 1] < 0:
            came = -2
            continue
        came = k
        problems.append(TableProblem(lines[there[k + 1]], name, _jump(step[k], gap_s[k])))
    return problems


def _jump(step: float, gap_s: float) -> str:
    jump = f"jumps by {step:.4g}° in {gap_s:.3g} s"
    return f"{jump}: a full turn is missing; unwrap the angle" if abs(abs(step) - 360) < 20 else jump

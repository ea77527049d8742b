"""Between runs, tables in memory (rad, mm) and the columns of measurement.md (degrees, mm).

An imported run holds its table as it came; a recorded one gets it by alignment. `file_table` is what
`rig export` writes of either.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyarrow as pa

from analysis.align import align
from analysis.files.layout import JOINTS, LAYOUTS, PLACE, TURN
from analysis.files.read import TableFile, read_csv
from analysis.kinematics.arm import Array
from analysis.tables import CircleTable, PoseTable, RadialTable, RepeatabilityTable, Table
from daq.store import Run
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.vocabulary import Direction, TestName

__all__ = ["TableFile", "columns_of", "file_table", "notes_of", "read_csv", "table_from", "table_of"]


def table_of(run: Run, rig: Rig) -> Table:
    """The table of an imported or recorded run.

    Raises FileError for a run without rows, or one whose test has no table yet.
    """
    if run.table is None:
        return _recorded(run, rig)
    return table_from(run.table, run.manifest.test, run.manifest.direction, str(run.path))


def table_from(columns: pa.Table, test: TestName, direction: Direction | None, where: str) -> Table:
    """A table in memory of the columns of measurement.md; extra columns are left out.

    Raises FileError where the columns are not those of the test, or hold no rows.
    """
    missing = [name for name in LAYOUTS[test].required if name not in columns.column_names]
    if missing or not columns.num_rows:
        what = f"its table has no {', '.join(missing) or 'rows'}"
        raise FileError(where, what, "import the table again")
    q = np.radians(_stack(columns, JOINTS))
    if test in ("yaw", "roll"):
        if direction is None:
            raise FileError(where, "has no direction, which a circle needs", "import it with --direction cw or acw")
        return CircleTable(
            "yaw" if test == "yaw" else "roll", direction, _floats(columns, "t_s"), q, _stack(columns, ("g1_mm", "g2_mm"))
        )
    if test == "pose":
        turned = set(TURN) <= set(columns.column_names)
        return PoseTable(q, _stack(columns, PLACE), np.radians(_stack(columns, TURN)) if turned else None)
    t_s = _floats(columns, "t_s") if "t_s" in columns.column_names else np.zeros(len(q))
    if test == "radial":
        polar, azimuth = (np.radians(_floats(columns, name)) for name in ("polar_deg", "azimuth_deg"))
        target, orientation = columns["target"].to_numpy(), columns["orientation"].to_numpy()
        return RadialTable(target, polar, azimuth, orientation, t_s, q, _floats(columns, "g1_mm"))
    approach = np.array(columns["approach"].to_pylist(), dtype=np.str_)
    target, rounds = columns["target"].to_numpy(), columns["round"].to_numpy()
    return RepeatabilityTable(target, approach, rounds, t_s, q, _floats(columns, "g1_mm"))


def columns_of(table: Table) -> pa.Table:
    """The columns of measurement.md, in its order: degrees and mm. A time of zeros only is no time, and left out."""
    joints = dict(zip(JOINTS, np.degrees(table.q).T, strict=True))
    match table:
        case CircleTable():
            gauges = {f"g{k}_mm": g_mm for k, g_mm in enumerate(table.g_mm.T, start=1)}
            return _table({"t_s": table.t_s, "direction": [table.direction] * len(table.t_s), **joints, **gauges})
        case PoseTable():
            turns = {} if table.rpy is None else dict(zip(TURN, np.degrees(table.rpy).T, strict=True))
            return _table({**joints, **dict(zip(PLACE, table.xyz_mm.T, strict=True)), **turns})
        case RadialTable():
            place = {"polar_deg": np.degrees(table.polar), "azimuth_deg": np.degrees(table.azimuth)}
            first = {"target": table.target, **place, "orientation": table.orientation}
        case RepeatabilityTable():
            first = {"target": table.target, "approach": table.approach.tolist(), "round": table.round}
    time = {"t_s": table.t_s} if table.t_s.any() else {}
    return _table({**first, **joints, "g1_mm": table.g_mm, **time})


def file_table(run: Run, rig: Rig) -> pa.Table:
    """What a file made of a run holds: the imported columns as they came, or the aligned ones. Raises FileError."""
    return columns_of(_recorded(run, rig)) if run.table is None else run.table


def notes_of(run: Run, rig: Rig) -> list[str]:
    """What a person should know of the table of a run, in words: rows left out, how the recording ended."""
    notes = []
    if run.manifest.exit_status != "complete":
        notes.append(f"the recording ended {run.manifest.exit_status}: {run.manifest.reason}")
    if run.table is None and run.manifest.test in _RECORDED:
        left_out = align(run.path, run, rig).left_out
        notes += [f"{name}: {count} rows left out for gaps" for name, count in left_out.items()]
    return notes


def _recorded_circle(test: Literal["yaw", "roll"]) -> Callable[[Run, Rig], Table]:
    def table(run: Run, rig: Rig) -> Table:
        direction = run.manifest.direction
        if direction is None:
            what = "has no direction, which a circle needs"
            raise FileError(str(run.path), what, "record it with --direction cw or acw")
        if rig.gauges.g2 is None:
            what = "has one gauge, and an angle takes two"
            raise FileError(str(run.path), what, "add gauges.g2 to the rig file")
        data = align(run.path, run, rig)
        return CircleTable(test, direction, data.t_s, data.q, data.g_mm)

    return table


_RECORDED: dict[TestName, Callable[[Run, Rig], Table]] = {
    "yaw": _recorded_circle("yaw"),
    "roll": _recorded_circle("roll"),
}
"""How the streams of a recorded run become a table. The tests that stop at targets are to be added here."""


def _recorded(run: Run, rig: Rig) -> Table:
    test = run.manifest.test
    if test not in _RECORDED:
        what = f"is a recorded {test} run, which has no table yet"
        raise FileError(str(run.path), what, "import the table of its readings: rig import")
    return _RECORDED[test](run, rig)


def _floats(columns: pa.Table, name: str) -> Array:
    return np.asarray(columns[name].to_numpy(), dtype=float)


def _stack(columns: pa.Table, names: tuple[str, ...]) -> Array:
    """Columns side by side: (n, k)."""
    return np.stack([_floats(columns, name) for name in names], axis=1)


def _table(columns: dict[str, Any]) -> pa.Table:
    return pa.table({name: pa.array(values) for name, values in columns.items()})



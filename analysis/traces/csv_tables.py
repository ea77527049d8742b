"""Between tables in memory (rad, mm) and the columns of docs/tables.md (degrees, mm)."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import pyarrow as pa

from analysis.kinematics.arm import Array
from analysis.traces.table_layout import PLACE, SOCKET, TURN, came_from_columns, joint_columns, layout_of
from analysis.traces.table_rules import hold_table
from analysis.traces.tables import CircleTable, PathTable, PoseTable, RadialTable, RepeatabilityTable, Table, TouchTable
from daq.store.arrays import array_of
from rigs.errors import FileError
from rigs.schema.vocabulary import Direction, TestName


def table_from(columns: pa.Table, test: TestName, direction: Direction | None, where: str) -> Table:
    """A table in memory of the columns of docs/tables.md; extra columns are left out.

    Raises FileError where the columns are not those of the test, hold no rows, or hold what no import lets through.
    """
    table = _table_from(columns, test, direction, where)
    hold_table(table, where)
    return table


def _table_from(columns: pa.Table, test: TestName, direction: Direction | None, where: str) -> Table:
    axes = _axes_in(columns)
    missing = [name for name in layout_of(test, axes).required if name not in columns.column_names]
    if missing or not columns.num_rows:
        what = f"its table has no {', '.join(missing) or 'rows'}"
        raise FileError(where, what, "import the table again")
    if test == "path":
        return PathTable(_floats(columns, "t_s"), _stack(columns, PLACE))
    q = np.radians(_stack(columns, joint_columns(axes)))
    if test in ("yaw", "roll"):
        if direction is None:
            raise FileError(where, "lacks a direction, which a circle needs", "import it with --direction cw or acw")
        g_mm = _stack(columns, ("g1_mm", "g2_mm"))
        u_t_s = _floats(columns, "u_t_s") if "u_t_s" in columns.column_names else None
        return CircleTable(_circle_test(test), direction, _floats(columns, "t_s"), q, g_mm, u_t_s)
    if test == "pose":
        turned = set(TURN) <= set(columns.column_names)
        return PoseTable(q, _stack(columns, PLACE), np.radians(_stack(columns, TURN)) if turned else None)
    if test == "touch":
        names = came_from_columns(axes)
        came_from = np.radians(_stack(columns, names)) if set(names) <= set(columns.column_names) else None
        return TouchTable(np.array(columns[SOCKET].to_pylist(), dtype=np.str_), q, came_from)
    t_s = _floats(columns, "t_s") if "t_s" in columns.column_names else np.zeros(len(q))
    if test == "radial":
        polar, azimuth = (np.radians(_floats(columns, name)) for name in ("polar_deg", "azimuth_deg"))
        target, orientation = array_of(columns["target"]), array_of(columns["orientation"])
        return RadialTable(target, polar, azimuth, orientation, t_s, q, _floats(columns, "g1_mm"))
    approach = np.array(columns["approach"].to_pylist(), dtype=np.str_)
    target, rounds = array_of(columns["target"]), array_of(columns["round"])
    return RepeatabilityTable(target, approach, rounds, t_s, q, _floats(columns, "g1_mm"))


def _axes_in(columns: pa.Table) -> int:
    """How many joints a table has: a seventh column that is none of the arm's is kept as text."""
    seventh = joint_columns(7)[-1]
    return 7 if seventh in columns.column_names and pa.types.is_floating(columns.schema.field(seventh).type) else 6


def u_lag_s_of(columns: pa.Table) -> float:
    """The standard uncertainty in s of the gauges' time against the joints' that all rows of a table share; 0 where it
    states none."""
    known = "u_lag_s" in columns.column_names and pa.types.is_floating(columns.schema.field("u_lag_s").type)
    return float(_floats(columns, "u_lag_s").max(initial=0.0)) if known else 0.0


def columns_of(table: Table) -> pa.Table:
    """The columns of docs/tables.md, in its order: degrees and mm. A time that is zero throughout is left out."""
    joints = dict(zip(joint_columns(table.q.shape[1]), np.degrees(table.q).T, strict=True))
    match table:
        case CircleTable():
            gauges = {f"g{k}_mm": g_mm for k, g_mm in enumerate(table.g_mm.T, start=1)}
            return _table({"t_s": table.t_s, "direction": [table.direction] * len(table.t_s), **joints, **gauges})
        case PoseTable():
            turns = {} if table.rpy is None else dict(zip(TURN, np.degrees(table.rpy).T, strict=True))
            return _table({**joints, **dict(zip(PLACE, table.xyz_mm.T, strict=True)), **turns})
        case PathTable():
            return _table({"t_s": table.t_s, **dict(zip(PLACE, table.xyz_mm.T, strict=True))})
        case TouchTable():
            names = came_from_columns(table.q.shape[1])
            came = {} if table.came_from is None else dict(zip(names, np.degrees(table.came_from).T, strict=True))
            return _table({SOCKET: table.socket.tolist(), **joints, **came})
        case RadialTable():
            place = {"polar_deg": np.degrees(table.polar), "azimuth_deg": np.degrees(table.azimuth)}
            first = {"target": table.target, **place, "orientation": table.orientation}
        case RepeatabilityTable():
            first = {"target": table.target, "approach": table.approach.tolist(), "round": table.round}
    time = {"t_s": table.t_s} if table.t_s.any() else {}
    return _table({**first, **joints, "g1_mm": table.g_mm, **time})


def _circle_test(test: TestName) -> Literal["yaw", "roll"]:
    return "yaw" if test == "yaw" else "roll"


def _floats(columns: pa.Table, name: str) -> Array:
    return np.asarray(array_of(columns[name]), dtype=float)


def _stack(columns: pa.Table, names: tuple[str, ...]) -> Array:
    """Columns side by side: (n, k)."""
    return np.stack([_floats(columns, name) for name in names], axis=1)


def _table(columns: dict[str, Any]) -> pa.Table:
    return pa.table({name: pa.array(values) for name, values in columns.items()})

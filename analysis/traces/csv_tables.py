"""Between tables in memory (rad, mm) and the columns of docs/tables.md (degrees, mm)."""

from __future__ import annotations

from itertools import takewhile
from typing import Any, Literal

import numpy as np
import pyarrow as pa

from analysis.kinematics.arm import RAIL_MM, Array
from analysis.traces.table_layout import (
    PLACE,
    RAIL,
    RAIL_FROM,
    SOCKET,
    TURN,
    came_from_columns,
    joint_columns,
    layout_of,
)
from analysis.traces.table_rules import hold_table
from analysis.traces.tables import (
    CircleTable,
    PathTable,
    PlaceTable,
    PoseTable,
    RadialTable,
    RepeatabilityTable,
    Table,
    TouchTable,
)
from daq.store.chunk import array_of
from rigs.errors import FileError
from rigs.schema.vocabulary import DRIVEN_AXES, FEWEST_AXES, MOST_AXES, Direction, TestName


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
    q, rail = np.radians(_stack(columns, joint_columns(axes))), _has_rail(columns)
    if test in ("yaw", "roll"):
        if direction is None:
            raise FileError(where, "lacks a direction, which a circle needs", "import it with --direction cw or acw")
        g_mm = _stack(columns, ("g1_mm", "g2_mm"))
        u_t_s = _floats(columns, "u_t_s") if "u_t_s" in columns.column_names else None
        return CircleTable(_circle_test(test), direction, _floats(columns, "t_s"), q, g_mm, u_t_s)
    if test == "pose":
        turned = set(TURN) <= set(columns.column_names)
        rpy = np.radians(_stack(columns, TURN)) if turned else None
        return PoseTable(_with_rail(q, columns, RAIL), _stack(columns, PLACE), rpy, rail=rail)
    if test == "touch":
        names = came_from_columns(axes)
        came = set(names) <= set(columns.column_names)
        sockets = np.array(columns[SOCKET].to_pylist(), dtype=np.str_)
        came_from = None
        if came:  # a rail of which it is not said comes from where it stands
            known = RAIL_FROM if RAIL_FROM in columns.column_names else RAIL
            came_from = _with_rail(np.radians(_stack(columns, names)), columns, known)
        return TouchTable(sockets, _with_rail(q, columns, RAIL), came_from, rail=rail)
    t_s = _floats(columns, "t_s") if "t_s" in columns.column_names else np.zeros(len(q))
    if test == "radial":
        polar, azimuth = (np.radians(_floats(columns, name)) for name in ("polar_deg", "azimuth_deg"))
        target, orientation = array_of(columns["target"]), array_of(columns["orientation"])
        return RadialTable(target, polar, azimuth, orientation, t_s, q, _floats(columns, "g1_mm"))
    approach = np.array(columns["approach"].to_pylist(), dtype=np.str_)
    target, rounds = array_of(columns["target"]), array_of(columns["round"])
    return RepeatabilityTable(target, approach, rounds, t_s, q, _floats(columns, "g1_mm"))


def _axes_in(columns: pa.Table) -> int:
    """How many joints a table has: of columns that are none of the arm's, as of a gripper, the names stay and the cells
    are text. Fewer than any arm has are those of six, some of which are missing."""
    joints = takewhile(lambda name: _is_number(columns, name), joint_columns(MOST_AXES))
    return len(count) if len(count := list(joints)) >= FEWEST_AXES else DRIVEN_AXES


def _is_number(columns: pa.Table, name: str) -> bool:
    """Whether a table has a column of that name and of numbers: one that is none of ours is kept as text."""
    return name in columns.column_names and pa.types.is_floating(columns.schema.field(name).type)


def _has_rail(columns: pa.Table) -> bool:
    """Whether a table says where a rail stands."""
    return _is_number(columns, RAIL)


def _with_rail(q: Array, columns: pa.Table, name: str) -> Array:
    """Angles q (n, axes) rad with where the rail stands, in m, if the table says it."""
    return np.column_stack([q, _floats(columns, name) / RAIL_MM]) if _has_rail(columns) else q


def _joints(q: Array, names: tuple[str, ...], rail: str) -> dict[str, Array]:
    """The columns of angles q (n, axes) rad by their names, in degrees, and of a rail behind them in mm."""
    axes = len(names)
    found = dict(zip(names, np.degrees(q[:, :axes]).T, strict=True))
    return found | ({rail: RAIL_MM * q[:, axes]} if q.shape[1] > axes else {})


def u_lag_s_of(columns: pa.Table) -> float:
    """The standard uncertainty in s of the gauges' time against the joints' that all rows of a table share; 0 where it
    states none."""
    return float(_floats(columns, "u_lag_s").max(initial=0.0)) if _is_number(columns, "u_lag_s") else 0.0


def columns_of(table: Table) -> pa.Table:
    """The columns of docs/tables.md, in its order: degrees and mm. A time that is zero throughout is left out."""
    axes = table.q.shape[1] - (isinstance(table, PlaceTable) and table.rail)
    joints = _joints(table.q, joint_columns(axes), RAIL)
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
            came = {} if table.came_from is None else _joints(table.came_from, came_from_columns(axes), RAIL_FROM)
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

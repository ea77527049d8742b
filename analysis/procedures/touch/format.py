"""Format of a table of touches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from analysis.procedures.shared.stop_cells import came_from_cells, came_from_of
from analysis.robot.kinematics.arm import Array
from analysis.runs.table_format import TableFormat
from analysis.runs.table_layout import RAIL, RAIL_FROM, SOCKET, Layout, came_from_columns, joint_columns
from analysis.runs.table_rows import Rows, joint_cells
from analysis.runs.tables import TouchTable
from rigs.schema.vocabulary import Direction


class TouchFormat(TableFormat[TouchTable]):
    """Columns of touches. Each row is a separate visit."""

    def layout(self, axes: int = 6, *, rail: bool = False) -> Layout:
        came_from = came_from_columns(axes)
        return Layout((SOCKET, *joint_columns(axes), *[RAIL] * rail), (*came_from, *[RAIL_FROM] * rail), (came_from,))

    def table_of(self, rows: Rows, direction: Direction | None, where: str) -> TouchTable:
        return TouchTable(rows.words(SOCKET), rows.with_rail(rows.q), came_from_of(rows), rail=rows.rail)

    def columns(self, table: TouchTable) -> Mapping[str, Array | Sequence[str]]:
        return {SOCKET: table.socket.tolist(), **joint_cells(table.q, rail=table.rail), **came_from_cells(table)}


PART = TouchFormat

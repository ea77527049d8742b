"""Format of a tracker recording along paths."""

from __future__ import annotations

from collections.abc import Mapping

from analysis.robot.kinematics.arm import Array
from analysis.runs.table_format import TableFormat
from analysis.runs.table_layout import PLACE, Layout
from analysis.runs.table_rows import Rows
from analysis.runs.tables import PathTable
from rigs.schema.vocabulary import Direction


class PathFormat(TableFormat[PathTable]):
    """Columns of a recording along paths."""

    def layout(self, axes: int = 6, *, rail: bool = False) -> Layout:
        return Layout(("t_s", *PLACE))

    def table_of(self, rows: Rows, direction: Direction | None, where: str) -> PathTable:
        return PathTable(rows.floats("t_s"), rows.stack(PLACE))

    def columns(self, table: PathTable) -> Mapping[str, Array]:
        return {"t_s": table.t_s, **dict(zip(PLACE, table.xyz_mm.T, strict=True))}


PART = PathFormat

"""Format of a table of heights."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from analysis.robot.kinematics.arm import Array
from analysis.runs.table_format import TableFormat
from analysis.runs.table_layout import Layout, joint_columns
from analysis.runs.table_rows import Rows, joint_cells
from analysis.runs.tables import Table
from rigs.schema.vocabulary import Direction, TestName


@dataclass(frozen=True)
class HeightTable(Table):
    """Heights of the tool: q (n, axes) rad; height_mm (n,) above the table."""

    test: ClassVar[TestName] = "height"
    q: Array
    height_mm: Array

    @property
    def readings(self) -> Array:
        """Heights (n, 1) mm."""
        return self.height_mm[:, None]


class HeightFormat(TableFormat[HeightTable]):
    """Columns of heights."""

    def layout(self, axes: int = 6, *, rail: bool = False) -> Layout:
        return Layout((*joint_columns(axes), "height_mm"))

    def table_of(self, rows: Rows, direction: Direction | None, where: str) -> HeightTable:
        return HeightTable(rows.q, rows.floats("height_mm"))

    def columns(self, table: HeightTable) -> Mapping[str, Array]:
        return {**joint_cells(table.q, rail=False), "height_mm": table.height_mm}


PART = HeightFormat

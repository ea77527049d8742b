"""Format of the table of a circle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import cast

from analysis.robot.kinematics.arm import Array
from analysis.runs.align import Aligned
from analysis.runs.table_format import TableFormat
from analysis.runs.table_layout import JOINTS, TIME_U, Layout
from analysis.runs.table_rows import Rows, joint_cells
from analysis.runs.tables import CircleTable
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.vocabulary import CircleTest, Direction, TestName


class CircleFormat(TableFormat[CircleTable]):
    """Columns of a circle."""

    gauges = ("g1", "g2")
    certified = ("g1", "g2", "ball")

    def __init__(self, test: TestName) -> None:
        super().__init__(test)
        self._test = cast("CircleTest", test)

    def layout(self, axes: int = 6, *, rail: bool = False) -> Layout:
        return Layout(("t_s", "direction", *JOINTS, "g1_mm", "g2_mm"), ("phi_deg", *TIME_U))

    def table_of(self, rows: Rows, direction: Direction | None, where: str) -> CircleTable:
        if direction is None:
            raise FileError(
                where, "lacks a direction, which a circle needs", "import the table with --direction cw or acw"
            )
        u_t_s = rows.floats("u_t_s") if rows.has(("u_t_s",)) else None
        return CircleTable(self._test, direction, rows.floats("t_s"), rows.q, rows.stack(("g1_mm", "g2_mm")), u_t_s)

    def columns(self, table: CircleTable) -> Mapping[str, Array | Sequence[str]]:
        gauges = {f"g{k}_mm": g_mm for k, g_mm in enumerate(table.g_mm.T, start=1)}
        stamps = {"t_s": table.t_s, "direction": [table.direction] * len(table.t_s)}
        return {**stamps, **joint_cells(table.q, rail=False), **gauges}

    def recorded(
        self, data: Aligned, rig: Rig, direction: Direction | None, where: str
    ) -> tuple[CircleTable, list[str]]:
        if direction is None:
            remedy = "add the direction: rig relabel RUN --direction acw or cw"
            raise FileError(where, "lacks a direction, which a circle needs", remedy)
        return CircleTable(self._test, direction, data.t_s, data.q, data.g_mm, data.u_t_s), []


PART = CircleFormat

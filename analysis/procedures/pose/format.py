"""Format of a table of tracker poses."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from analysis.procedures.shared.stop_cells import came_from_cells, came_from_of
from analysis.robot.kinematics.arm import Array, Mask
from analysis.runs.stands import STANDSTILL_MM, standstill_starts_of_visits
from analysis.runs.table_format import TableFormat
from analysis.runs.table_layout import (
    CONTROLLER_PLACE,
    CONTROLLER_TURN,
    PLACE,
    RAIL,
    RAIL_FROM,
    TURN,
    Layout,
    came_from_columns,
    joint_columns,
)
from analysis.runs.table_rows import Rows, joint_cells
from analysis.runs.tables import PoseTable
from rigs.schema.vocabulary import Direction


class PoseFormat(TableFormat[PoseTable]):
    """Columns of tracker poses."""

    def layout(self, axes: int = 6, *, rail: bool = False) -> Layout:
        came_from = came_from_columns(axes)
        optional = (*TURN, *came_from, *CONTROLLER_PLACE, *CONTROLLER_TURN, *[RAIL_FROM] * rail)
        together = (TURN, came_from, CONTROLLER_PLACE, CONTROLLER_TURN)
        return Layout((*joint_columns(axes), *[RAIL] * rail, *PLACE), optional, together)

    def table_of(self, rows: Rows, direction: Direction | None, where: str) -> PoseTable:
        rpy = np.radians(rows.stack(TURN)) if rows.has(TURN) else None
        return PoseTable(rows.with_rail(rows.q), rows.stack(PLACE), rpy, rail=rows.rail, came_from=came_from_of(rows))

    def columns(self, table: PoseTable) -> Mapping[str, Array]:
        turns = {} if table.rpy is None else dict(zip(TURN, np.degrees(table.rpy).T, strict=True))
        places = dict(zip(PLACE, table.xyz_mm.T, strict=True))
        return {**joint_cells(table.q, rail=table.rail), **places, **turns, **came_from_cells(table)}

    def stands(self, table: PoseTable) -> Mask:
        far = np.linalg.norm(np.diff(table.xyz_mm, axis=0), axis=1) > STANDSTILL_MM
        return standstill_starts_of_visits(table.q, np.asarray(far | table.lost[1:] | table.lost[:-1]))

    def averaged(self, table: PoseTable, first: Mask, mean: Callable[[Array], Array]) -> PoseTable:
        from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import, needed here only

        averaged = replace(super().averaged(table, first, mean), row=table.rows[first])
        if table.rpy is None:
            return averaged
        turns, stand = table.rpy[first].copy(), np.cumsum(first) - 1
        for number in np.flatnonzero(np.bincount(stand) > 1).tolist():
            turns[number] = Rotation.from_euler("xyz", table.rpy[stand == number]).mean().as_euler("xyz")
        return replace(averaged, rpy=turns)


PART = PoseFormat

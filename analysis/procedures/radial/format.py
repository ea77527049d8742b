"""Format of a table of the radial test."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from analysis.procedures.shared.stop_cells import timed, visit_starts
from analysis.robot.geometry.driven_programs import hemisphere_of, radial_program
from analysis.robot.kinematics.arm import Array, Integers, Mask
from analysis.runs.align import Aligned
from analysis.runs.noise.certificate import link_excess_mm
from analysis.runs.stands import at_targets, stands_of, visits_of
from analysis.runs.table_format import TableFormat
from analysis.runs.table_layout import JOINTS, Layout
from analysis.runs.table_rows import Rows, joint_cells
from analysis.runs.tables import RadialTable
from rigs.rig import Rig
from rigs.schema.vocabulary import Direction


class RadialFormat(TableFormat[RadialTable]):
    """Columns of the radial test."""

    gauges = ("g1",)
    certified = ("g1", "ball", "link")

    def layout(self, axes: int = 6, *, rail: bool = False) -> Layout:
        return Layout(("target", "polar_deg", "azimuth_deg", "orientation", *JOINTS, "g1_mm"), ("t_s",))

    def table_of(self, rows: Rows, direction: Direction | None, where: str) -> RadialTable:
        polar, azimuth = (np.radians(rows.floats(name)) for name in ("polar_deg", "azimuth_deg"))
        target, orientation = rows.counts("target"), rows.counts("orientation")
        return RadialTable(target, polar, azimuth, orientation, rows.times(), rows.q, rows.floats("g1_mm"))

    def columns(self, table: RadialTable) -> Mapping[str, Array | Integers]:
        place = {"polar_deg": np.degrees(table.polar), "azimuth_deg": np.degrees(table.azimuth)}
        first = {"target": table.target, **place, "orientation": table.orientation}
        return {**first, **joint_cells(table.q, rail=False), "g1_mm": table.g_mm, **timed(table.t_s)}

    def stands(self, table: RadialTable) -> Mask:
        return visit_starts(table, np.stack([table.target, table.orientation], axis=1))

    def recorded(
        self, data: Aligned, rig: Rig, direction: Direction | None, where: str
    ) -> tuple[RadialTable, list[str]]:
        """Return the table of stops at targets, with the certified difference between link length and radius."""
        stands, program = stands_of(data.t_s, data.q, data.g_mm), radial_program(rig)
        at = at_targets(stands, program, rig)
        order = list(zip(program.target.tolist(), program.orientation.tolist(), strict=True))
        once = len(order) // hemisphere_of(rig).visits
        visits = visits_of(at, [order[row] for _, row in at], order, once, program, where)
        elsewhere, rows = len(stands) - len(at), visits.rows
        doubts = [f"{elsewhere} stops are ignored because they are not at a target"] if elsewhere else []
        table = RadialTable(
            program.target[rows], program.polar[rows], program.azimuth[rows], program.orientation[rows],
            visits.t_s, visits.q, visits.g_mm + link_excess_mm(rig),
        )  # fmt: skip
        return table, doubts + visits.doubts


PART = RadialFormat

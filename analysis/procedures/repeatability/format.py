"""Format of a table of the repeatability test."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from analysis.procedures.shared.stop_cells import timed, visit_starts
from analysis.robot.geometry.driven_programs import hemisphere_of, repeatability_of, repeatability_program
from analysis.robot.geometry.hemisphere import hemisphere_frame
from analysis.robot.kinematics.arm import Array, Integers, Mask, arm_of, forward
from analysis.runs.align import Aligned
from analysis.runs.stands import at_targets, stands_of, visits_of
from analysis.runs.table_format import TableFormat
from analysis.runs.table_layout import JOINTS, Layout
from analysis.runs.table_rows import Rows, joint_cells
from analysis.runs.tables import RepeatabilityTable
from rigs.rig import Rig
from rigs.schema.vocabulary import Direction


class RepeatabilityFormat(TableFormat[RepeatabilityTable]):
    """Columns of the repeatability test."""

    gauges = ("g1",)
    certified = ("g1", "ball")

    def layout(self, axes: int = 6, *, rail: bool = False) -> Layout:
        return Layout(("target", "approach", "round", *JOINTS, "g1_mm"), ("t_s",))

    def table_of(self, rows: Rows, direction: Direction | None, where: str) -> RepeatabilityTable:
        labels = rows.counts("target"), rows.words("approach"), rows.counts("round")
        return RepeatabilityTable(*labels, rows.times(), rows.q, rows.floats("g1_mm"))

    def columns(self, table: RepeatabilityTable) -> Mapping[str, Array | Integers | Sequence[str]]:
        first = {"target": table.target, "approach": table.approach.tolist(), "round": table.round}
        return {**first, **joint_cells(table.q, rail=False), "g1_mm": table.g_mm, **timed(table.t_s)}

    def stands(self, table: RepeatabilityTable) -> Mask:
        side = np.unique(table.approach, return_inverse=True)[1]
        return visit_starts(table, np.stack([table.target, side, table.round], axis=1))

    def recorded(
        self, data: Aligned, rig: Rig, direction: Direction | None, where: str
    ) -> tuple[RepeatabilityTable, list[str]]:
        """Return the table of stops at targets, each with its side of approach."""
        stands, program = stands_of(data.t_s, data.q, data.g_mm), repeatability_program(rig)
        frame, arm = hemisphere_frame(hemisphere_of(rig)), arm_of(rig.robot)
        limit_mm = repeatability_of(rig).approach_mm / 2
        outwards_mm = np.linalg.norm(forward(arm, data.q)[:, :3, 3] - frame.centre, axis=1) - frame.radius
        at = at_targets(stands, program, rig, np.pi)
        at = [(stand, row) for stand, row in at if abs(outwards_mm[stand.begin : stand.end].mean()) < limit_mm]
        sides = ["none"]  # tool positions beyond the limit since the last stop at the same row
        for (before, last), (now, row) in pairwise(at):
            way = outwards_mm[before.end : now.begin]
            furthest = way[np.argmax(np.abs(way))] if len(way) else 0.0
            sides.append("none" if last != row or abs(furthest) < limit_mm else "out" if furthest > 0 else "in")
        sides = sides[: len(at)]
        places = [(row, side) for (_, row), side in zip(at, sides, strict=True)]
        ways = ["none", *["out", "in"] * repeatability_of(rig).rounds]
        order = [(row, side) for row in range(len(program.target)) for side in ways]
        visits = visits_of(at, places, order, len(order), program, where)
        times, rounds = Counter[tuple[int, str]](), list[int]()  # a round is the count of a side at a target
        for place in (places[k] for k in visits.number):
            times[place] += 1
            rounds.append(times[place])
        came_from = np.array([sides[k] for k in visits.number])
        target, number = program.target[visits.rows], np.array(rounds, dtype=np.int64)
        return RepeatabilityTable(target, came_from, number, visits.t_s, visits.q, visits.g_mm), visits.doubts


PART = RepeatabilityFormat

"""The poses after which the arm is known best over the workspace."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from analysis.apps.planning.pose_pool import Sight, axes_in_turn, drawn_poses, in_order_of_ways, joint_ranges
from analysis.apps.planning.possible_readings import block_of, pose_table, typical_columns, typical_rows
from analysis.apps.planning.reading_pool import ReadingPool
from analysis.diagnosis.fit.candidates import Columns
from analysis.diagnosis.fit.responses import linearise
from analysis.diagnosis.plan.expected import without_bands
from analysis.robot.kinematics.arm import Array, arm_of, forward
from analysis.runs.tables import came_from_columns, joint_columns
from analysis.runs.written_files import csv_text
from rigs.errors import FileError, RigPlace
from rigs.rig import Rig

_POOL = 400
_SEED, _SHUFFLES = 0, 5
"""Seed of the draw, for reproducible plans, and number of random choices compared. Chosen."""


@dataclass(frozen=True)
class PlannedPoses:
    q: Array
    """Joint angles (n, axes) in rad."""
    xyz_mm: Array
    """Places (n, 3) of the nominal tool in the world."""
    u_mm: float
    """Expected uncertainty of the tool position over the workspace after these poses."""
    random_u_mm: float
    """The same after an equal number of random poses."""
    as_good: int | None
    """Number of random poses with equal uncertainty; None if larger than tried, or for motion of single axes."""
    asked: int
    one_axis: bool = False
    """Each axis moves down, up and back while the others stand."""

    def lines(self) -> list[str]:
        lines = [
            f"{len(self.q)} poses determine the tool position over the workspace to {1e3 * self.u_mm:.0f} µm "
            "(expected rms, for an arm with typical errors, frame and tool fitted)"
        ]
        as_good = "no tried number of random poses is as good"
        if self.as_good:
            as_good = f"{self.as_good} random poses are equally good"
        compared = f"the same number of random poses: {1e3 * self.random_u_mm:.0f} µm"
        if self.one_axis:
            lines.append(
                "each axis moves down, up and back while the others rest: rig analyse shows its error curve by "
                f"direction and its play; {compared}: measure some as well to calibrate the arm"
            )
        else:
            lines.append(f"{compared}; {as_good}")
        if left_out := self.asked - len(self.q):
            lines.append(f"{left_out} of {self.asked} poses are ignored, because no clear move leads to them")
        return [*lines, "covers, cables and obstacles are unknown: watch the first run with a hand on the stop button"]

    def csv(self) -> str:
        axes = self.q.shape[1]
        header = ["pose", *joint_columns(axes), *came_from_columns(axes), "nominal_x_mm", "nominal_y_mm"]
        came_from = np.vstack([self.q[:1], self.q[:-1]])
        rows = np.column_stack([np.degrees(self.q), np.degrees(came_from), self.xyz_mm])
        cells = ([k, *(f"{number:.6f}" for number in row)] for k, row in enumerate(rows.tolist(), start=1))
        return csv_text([[*header, "nominal_z_mm"], *cells])

    def to_dict(self) -> dict[str, Any]:
        return {
            "poses": [
                {"q_deg": q, "xyz_mm": p}
                for q, p in zip(np.degrees(self.q).tolist(), self.xyz_mm.tolist(), strict=True)
            ],
            "u_mm": self.u_mm,
            "random_u_mm": self.random_u_mm,
            "as_good": self.as_good,
        }


def planned_poses(rig: Rig, count: int, sight: Sight | None = None, *, one_axis: bool = False) -> PlannedPoses:
    """Plan poses, reachable, collision-free and visible to a tracker, over the workspace or axis by axis."""
    if rig.robot.rail:
        problem = "has a rail, but poses can be planned only for a fixed base"
        remedy = "leave out robot.rail, and add e1_mm, spread over the rail, by hand"
        raise FileError(RigPlace.of(rig.name), problem, remedy, code="arm.invalid")
    arm, rng = arm_of(rig.robot), np.random.default_rng(_SEED)
    low, high = joint_ranges(arm)
    for axis in np.flatnonzero(low >= high).tolist():
        first, last = rig.robot.axes[axis].limits_deg
        where = RigPlace.of(rig.name, f"robot.axes[{axis + 1}]")
        problem = f"limits_deg [{first:g}, {last:g}] leave {rig.robot.axis_words(axis + 1)} no room to move"
        raise FileError(where, problem, "give them in degrees", code="rig_file.invalid")
    q = drawn_poses(arm, max(_POOL, 3 * count), sight, rng)
    if len(q) < 2 * count:
        problem = f"only {len(q)} poses were found that the arm takes clear of floor and column, and that are seen"
        remedy = "move the tracker, turn the target, or plan fewer poses"
        raise FileError(RigPlace.of(rig.name), problem, remedy, code="readings.too_few")
    driven = axes_in_turn(arm, count, sight, rng) if one_axis else None
    pool = pool_of(rig, q if driven is None else np.vstack([q, driven]))
    chosen = pool.choose(count) if driven is None else np.arange(len(q), len(pool.readings))
    u_mm = pool.u_mm(chosen)
    shuffled = [rng.permutation(len(q)) for _ in range(_SHUFFLES)]

    def random(number: int) -> float:
        return float(np.median([pool.u_mm(order[:number]) for order in shuffled]))

    further = (number for number in range(len(chosen), len(q), max(1, count // 15)))
    as_good = None if one_axis else next((number for number in further if random(number) <= u_mm), None)
    if driven is None:
        driven = in_order_of_ways(arm, q[chosen])
    places = forward(arm, driven)[:, :3, 3]
    asked = len(driven) if one_axis else count
    return PlannedPoses(driven, places, u_mm, random(len(chosen)), as_good, asked, one_axis)


def pool_of(rig: Rig, q: Array) -> ReadingPool:
    """Poses q (n, axes) rad of a tracker as possible readings and as targets."""
    columns, sd_mm = pose_columns(rig, q)
    rows = typical_rows(columns)
    return ReadingPool(rows.reshape(len(q), 3, -1), rows * sd_mm[:, None], np.ones(len(q)))


def pose_columns(rig: Rig, q: Array) -> tuple[Columns, Array]:
    """Columns of a diagnosis for tracker poses at q (n, axes) rad, without play, and the noise (3 n,) in mm."""
    block, setup = block_of(rig, pose_table(rig, q))
    return typical_columns(linearise(without_bands([block]), {block.setup: setup})), block.sd_mm

"""Repeatability test: scatter of the distance in repeated approaches to a target, from one side and from both.

After Oh 2019, section 2.3 and figure 15 (ranges), ISO 9283 (RP) and ISO 230-2 (R, B). Scatter is the measurand, and a
few readings per side determine it poorly: the uncertainty of a figure is its deviation from the expectation in
repeated tests on the same robot. Targets scatter differently, with heavy tails (`analysis.runs.noise.target_scatter`);
2 u contains 95 % of such tests. So a figure should be compared with its expectation for the same number of readings
and targets: the largest range grows with both; 4 s does not.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from analysis.procedures.shared.quantity import Quantity
from analysis.procedures.shared.result_curves import RepeatabilityCurve
from analysis.procedures.shared.scatter_figures import (
    RANGE_VISITS,
    RP_VISITS,
    assumed,
    coarse,
    exact,
    of_scatter,
    reversal,
    rp,
)
from analysis.procedures.shared.test_kind import Instruments, Labels, Simulation, check_numbers, require_live_gauges
from analysis.procedures.simulate import read_by_gauges, visit_times
from analysis.procedures.stops import TargetTest, require_known_targets, visit_starts
from analysis.robot.geometry.driven_programs import (
    displace_tool,
    hemisphere_frame,
    hemisphere_of,
    repeatability_of,
    repeatability_program,
    target_angles,
)
from analysis.robot.kinematics.arm import Array, Integers, Mask, arm_of, forward
from analysis.robot.predict import Model, Path, stops
from analysis.runs.align import Aligned
from analysis.runs.noise.cell_noise import TARGET_MM
from analysis.runs.noise.readings import SPREADS, spreads_of, step_of_stops
from analysis.runs.noise.target_scatter import scatter_of
from analysis.runs.stands import at_targets, stands_of, visits_of
from analysis.runs.tables import RepeatabilityTable
from rigs.errors import FileError
from rigs.readiness import require_test
from rigs.rig import Rig
from rigs.schema.declared_tests import Hemisphere
from rigs.schema.vocabulary import Direction
from rigs.text import listed

SIDES = ("out", "in")


@dataclass(frozen=True)
class RepeatabilityResult:
    """Result of a repeatability test. targets (t,); readings_mm (t, 2, n): sides out and in, in order of time, NaN
    if missing.
    """

    targets: Integers
    readings_mm: Array
    figures: dict[str, Quantity]
    samples: int
    notes: tuple[str, ...]

    @property
    def as_curve(self) -> RepeatabilityCurve:
        target, side, visit = np.nonzero(np.isfinite(self.readings_mm))
        readings_mm = self.readings_mm[target, side, visit]
        return RepeatabilityCurve(self.targets[target], np.array(SIDES)[side], visit + 1, readings_mm)


def evaluate(table: RepeatabilityTable, u_mm: float, where: str = "the repeatability run") -> RepeatabilityResult:
    """Figures of repeated approaches.

    u_mm: standard uncertainty of a gauge reading without its step, 0 for exact (simulated) readings.

    figures: uni_mm and bi_mm, largest range within one side and over both; uni_mean_mm, bi_mean_mm over the targets;
    rp_mm and rp_mean_mm (ISO 9283, within one side); r_out_mm (↓), r_in_mm (↑), r_mm, reversal_mm (largest |B|) and
    reversal_mean_mm (mean B = mean from inside less mean from outside), ISO 230-2. Raises FileError.
    """
    if len(table.g_mm) == 0:
        raise FileError(where, "has no rows", "give a table with readings", code="readings.too_few")
    check_numbers(where, g1_mm=table.g_mm)
    require_live_gauges(where, g1_mm=table.g_mm)
    if unknown := sorted({str(name) for name in table.approach} - {"none", *SIDES}):
        remedy = "write out, in or none for the side of approach"
        raise FileError(where, f"approach {unknown[0]!r} is not a side", remedy, code="table.invalid")
    targets, x, notes = _sides(table, where)
    scatter = scatter_of(x, u_mm, step_mm=step_of_stops(table.g_mm)) if u_mm > 0 else None
    figures = of_scatter(plain_figures, x, scatter) if scatter else exact(plain_figures, x)
    # Outliers are kept, because the standards remove none.
    away = np.abs(x - np.nanmedian(x, axis=-1, keepdims=True))
    spreads = np.zeros(x.shape)
    spreads[np.isfinite(away)] = spreads_of(away[np.isfinite(away)], TARGET_MM.high)
    if wild := int((spreads > SPREADS).sum()):
        row, side, _ = np.unravel_index(int(np.argmax(spreads)), x.shape)
        most = f"up to {np.nanmax(away):.3g} mm from the others of the target and side"
        where_most = f"target {targets[row]}, {SIDES[side]}"
        are = "1 reading is" if wild == 1 else f"{wild} readings are"
        remedy = "check that the plunger touched and that the robot was at rest"
        notes += (f"{are} {most} ({where_most}), and included in the figures: {remedy}",)
    least = int(np.isfinite(x).sum(axis=-1).min())
    standards = (("ISO 230-2", RANGE_VISITS), ("ISO 9283", RP_VISITS))
    if asked := ", ".join(f"{name} requires {count}" for name, count in standards if least < count):
        notes += (f"{least} readings a side; {asked}",)
    notes += assumed(scatter) + coarse(scatter)
    return RepeatabilityResult(targets, x, figures, int(np.isfinite(x).sum()), notes)


def plain_figures(x: Array) -> dict[str, Array]:
    uni, bi, repeat = _range(x), _range(x.reshape(*x.shape[:-2], -1)), rp(x[..., None])
    return {
        "uni_mm": uni.max(axis=(-2, -1)),
        "uni_mean_mm": uni.mean(axis=(-2, -1)),
        "bi_mm": bi.max(axis=-1),
        "bi_mean_mm": bi.mean(axis=-1),
        "rp_mm": repeat.max(axis=(-2, -1)),
        "rp_mean_mm": repeat.mean(axis=(-2, -1)),
        **reversal(x),
    }


def _range(x: Array) -> Array:
    return np.asarray(np.nanmax(x, axis=-1) - np.nanmin(x, axis=-1))


def _sides(table: RepeatabilityTable, where: str) -> tuple[Integers, Array, tuple[str, ...]]:
    """Targets with at least two readings from each side, and these readings (t, 2, n) mm padded with NaN."""
    every = np.unique(table.target)
    cells = {
        int(target): [table.g_mm[(table.target == target) & (table.approach == side)] for side in SIDES]
        for target in every
    }
    kept = [target for target, sides in cells.items() if min(len(side) for side in sides) >= 2]
    if not kept:
        remedy = "approach each target three times from outside and from inside"
        raise FileError(where, "the targets were not read twice from each side", remedy, code="table.invalid")
    width = max(len(side) for target in kept for side in cells[target])
    x = np.full((len(kept), 2, width), np.nan)
    for row, target in enumerate(kept):
        for column, side in enumerate(cells[target]):
            x[row, column, : len(side)] = side
    dropped = [target for target in cells if target not in kept]
    notes = [f"target {listed(dropped)} ignored: fewer than two readings from a side"] if dropped else []
    without = int((table.approach == "none").sum())
    notes += [f"{without} readings do not state their approach and are not used"] if without else []
    return np.array(kept), x, tuple(notes)


class Repeatability(TargetTest[RepeatabilityTable]):
    """Repeated approaches to the targets of a hemisphere, from outside and from inside."""

    test = "repeatability"
    labels = Labels(
        example=("bi_mm", 0.05, 0.10), part="hemisphere", further=("repeatability", "the same places from both sides")
    )
    table = RepeatabilityTable
    fields = ("target", "approach", "round", "q", "g_mm")
    optional = ("t_s",)
    gauges = ("g1",)
    certified = ("g1", "ball")

    def stands(self, table: RepeatabilityTable) -> Mask:
        side = np.unique(table.approach, return_inverse=True)[1]
        return visit_starts(table, np.stack([table.target, side, table.round], axis=1))

    def recorded(
        self, data: Aligned, rig: Rig, direction: Direction | None, where: str
    ) -> tuple[RepeatabilityTable, list[str]]:
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

    def evaluate(
        self, table: RepeatabilityTable, rig: Rig, where: str, instruments: Instruments
    ) -> RepeatabilityResult:
        require_known_targets(table, rig, where)
        return evaluate(table, instruments.u_mm(rig), where)

    def simulated(self, rig: Rig, direction: Direction | None, run: Simulation) -> RepeatabilityTable:
        require_test(rig, self.test)
        table = _program_table(rig)
        return table.with_readings(read_by_gauges(rig, table, self.setup(rig), run))

    def path(self, model: Model, table: RepeatabilityTable) -> Path:
        hemisphere = hemisphere_of(model.rig)
        polar, azimuth = (angles[table.target - 1] for angles in target_angles(hemisphere))
        side = np.select([table.approach == "out", table.approach == "in"], [1.0, -1.0], 0.0)
        away = (side * repeatability_of(model.rig).approach_mm)[:, None]
        came_from = displace_tool(model.arm, table.q, away * hemisphere_frame(hemisphere).direction(polar, azimuth))
        return stops(table.q, table.t_s, came_from)

    def directions(self, table: RepeatabilityTable, hemisphere: Hemisphere) -> tuple[Array, Array] | None:
        polar, azimuth = target_angles(hemisphere)
        if table.target.min() < 1 or table.target.max() > len(polar):
            return None
        return polar[table.target - 1], azimuth[table.target - 1]

    def visits(self, table: RepeatabilityTable) -> Integers:
        side = np.select([table.approach == "out", table.approach == "in"], [1, 2], 0)
        return np.stack([table.target, side], axis=1)


def _program_table(rig: Rig) -> RepeatabilityTable:
    at, rounds = repeatability_program(rig), repeatability_of(rig).rounds
    approach = np.array(["none", *["out", "in"] * rounds])
    number = np.array([1, *np.repeat(np.arange(1, rounds + 1), 2)])
    k = len(approach)
    return RepeatabilityTable(
        np.repeat(at.target, k),
        np.tile(approach, len(at.q)),
        np.tile(number, len(at.q)),
        visit_times(k * len(at.q)),
        np.repeat(at.q, k, axis=0),
        np.empty(0),
    )

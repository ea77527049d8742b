"""The tests on a circle, read by two gauges while the robot moves: what yaw and roll have in common."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from analysis.conventions.finding import Finding
from analysis.conventions.joints import PLACE_UNKNOWN, Verdict, judged_by_path
from analysis.conventions.off_path import Off, off_circle
from analysis.conventions.place import STAMPS, stamp_findings
from analysis.conventions.units import circle_gauges, impossible
from analysis.geometry.ball_link import readings
from analysis.geometry.circle import frame_of
from analysis.geometry.programs import circle_of
from analysis.kinematics.arm import Array, Integers
from analysis.measures.evaluate import Instruments
from analysis.measures.link_angle import AngleTest, CircleResult
from analysis.model.hysteresis import Motion
from analysis.model.predict import Model, Path, SetUp, gauged
from analysis.model.scene import Scene, apply
from analysis.traces.align import Aligned
from analysis.traces.csv_tables import Rows, joint_cells
from analysis.traces.kind import Kind
from analysis.traces.laps import laps_of
from analysis.traces.table_layout import JOINTS, TIME_U, Layout
from analysis.traces.tables import CircleTable
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.effect import Gauge
from rigs.schema.vocabulary import Direction


class CircleKind(Kind[CircleTable]):
    """Yaw or roll."""

    gauges: tuple[Gauge, ...] = ("g1", "g2")
    certified = ("g1", "g2", "ball")
    swept = in_order_of_time = True
    setup_terms = 5
    finders: Mapping[str, Callable[[CircleTable, Rig], Iterable[Finding]]] = {STAMPS: stamp_findings}

    def __init__(self, test: Literal["yaw", "roll"], angle: AngleTest) -> None:
        super().__init__(test)
        self._test: Literal["yaw", "roll"] = test
        self._angle = angle

    def layout(self, axes: int = 6, *, rail: bool = False) -> Layout:
        return Layout(("t_s", "direction", *JOINTS, "g1_mm", "g2_mm"), ("phi_deg", *TIME_U))

    def table_of(self, rows: Rows, direction: Direction | None, where: str) -> CircleTable:
        if direction is None:
            raise FileError(where, "lacks a direction, which a circle needs", "import it with --direction cw or acw")
        u_t_s = rows.floats("u_t_s") if rows.has(("u_t_s",)) else None
        return CircleTable(self._test, direction, rows.floats("t_s"), rows.q, rows.stack(("g1_mm", "g2_mm")), u_t_s)

    def columns(self, table: CircleTable) -> Mapping[str, Array | Sequence[str]]:
        gauges = {f"g{k}_mm": g_mm for k, g_mm in enumerate(table.g_mm.T, start=1)}
        stamps = {"t_s": table.t_s, "direction": [table.direction] * len(table.t_s)}
        return {**stamps, **joint_cells(table.q, rail=False), **gauges}

    def readings(self, table: CircleTable) -> Array:
        return table.g_mm

    def recorded(
        self, data: Aligned, rig: Rig, direction: Direction | None, where: str
    ) -> tuple[CircleTable, list[str]]:
        if direction is None:
            remedy = "give it one: rig relabel RUN --direction acw or cw"
            raise FileError(where, "lacks a direction, which a circle needs", remedy)
        return CircleTable(self._test, direction, data.t_s, data.q, data.g_mm, data.u_t_s), []

    def setup(self, rig: Rig) -> SetUp:
        return SetUp(np.array(circle_of(rig).centre_mm), np.zeros(2), np.eye(4), np.eye(4))

    def path(self, model: Model, table: CircleTable) -> Path:
        return Path(Motion(table.t_s, table.q), np.arange(len(table.q)))

    def read(self, model: Model, table: CircleTable, path: Path, scene: Scene, setup: SetUp) -> Array:
        """The readings of both gauges (m, 2) mm."""
        to_tool = scene.T[:, :3, 3] - setup.ball
        circle = frame_of(circle_of(model.rig))
        offsets = np.array([gauge.offset_mm for _, gauge in model.rig.gauges])
        contact = np.arctan2(to_tool @ circle.v, to_tool @ circle.u)
        scene = apply(model.effects, "setup", replace(scene, contact=contact, offsets_mm=offsets))
        g_mm = readings(scene.T, setup.ball, scene.offsets_mm, table.test, circle.radius, scene.form_mm)
        return gauged(model, path, scene, setup, g_mm)

    def unit_findings(self, table: CircleTable, rig: Rig, T_tool: Array) -> Iterable[Finding]:
        return impossible(circle_gauges(table, rig, T_tool))

    def cannot_tell(self, table: CircleTable, rig: Rig) -> str:
        return "" if rig.tests.circle else PLACE_UNKNOWN

    def judged_joints(self, table: CircleTable, rig: Rig) -> Verdict:
        return judged_by_path(table, rig)

    def off_path(self, table: CircleTable, rig: Rig, T_tool: Array) -> Off | None:
        return off_circle(T_tool, rig.tests.circle) if rig.tests.circle else None

    def thinned(self, table: CircleTable, count: int) -> CircleTable:
        if len(table.q) <= count:
            return table
        rows = slice(None, None, len(table.q) // count)
        return CircleTable(table.test, table.direction, table.t_s[rows], table.q[rows], table.g_mm[rows])

    def rows_used(self, table: CircleTable, rig: Rig, where: str) -> Integers:
        return np.searchsorted(table.t_s, laps_of(table, rig, where).t_s)

    def evaluate(self, table: CircleTable, rig: Rig, where: str, instruments: Instruments) -> CircleResult:
        gauges = rig.gauges
        if gauges.g2 is None:
            raise FileError(where, "has one gauge, and an angle needs two", "add gauges.g2 to the rig file")
        laps = laps_of(table, rig, where)
        return self._angle.evaluate(
            laps, gauges.baseline_mm, gauges.baseline_u_mm, instruments.u_lag_s, where, instruments.like
        )

    def hold_evaluable(self, table: CircleTable, rig: Rig, where: str) -> None:
        """It has laps."""
        laps_of(table, rig, where)

    def direction(self, table: CircleTable) -> Direction:
        return table.direction

"""Common parts of tests with stops: one gauge at hemisphere targets, or positions of postures."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable
from dataclasses import replace
from typing import TypeVar

import numpy as np

from analysis.procedures.checks.finding import Finding
from analysis.procedures.checks.meanings import PLACE_UNKNOWN, Verdict, judged_by_path
from analysis.procedures.checks.place import PLACE, Off, off_targets, place_findings
from analysis.procedures.checks.units import target_units
from analysis.procedures.shared.simulated_gauges import Simulation, read_by_gauges
from analysis.robot.geometry.driven_programs import hemisphere_of
from analysis.robot.geometry.hemisphere import hemisphere_frame, target_angles
from analysis.robot.kinematics.arm import Array, Integers, Mask
from analysis.robot.model.predict import Model, Path, SetUp, gauged, stops, visits
from analysis.robot.model.scene import Scene, apply
from analysis.runs.csv_tables import Rows, joint_cells
from analysis.runs.stands import STANDS_MM
from analysis.runs.table_format import SAME_RAD, Kind
from analysis.runs.table_layout import RAIL, RAIL_FROM, came_from_columns
from analysis.runs.tables import PlaceTable, TargetTable, last_moves
from rigs.errors import FileError
from rigs.readiness import require_test
from rigs.rig import Rig
from rigs.schema.declared_tests import Hemisphere
from rigs.schema.vocabulary import Direction

H = TypeVar("H", bound=TargetTable)


class TargetKind(Kind[H]):
    """Test at targets."""

    gauges = ("g1",)
    part = "hemisphere"
    finders = ((PLACE, place_findings),)

    @abstractmethod
    def directions(self, table: H, hemisphere: Hemisphere) -> tuple[Array, Array] | None:
        """Return polar angle and azimuth (n,) rad of each row's target; None if the hemisphere lacks a target."""

    def readings(self, table: H) -> Array:
        return table.g_mm[:, None]

    @abstractmethod
    def driven(self, rig: Rig) -> H:
        """Return the table of the program, without readings."""

    def with_readings(self, table: H, values: Array) -> H:
        return replace(table, g_mm=values[:, 0])

    def simulated(self, rig: Rig, direction: Direction | None, run: Simulation) -> H:
        require_test(rig, self.test)
        table = self.driven(rig)
        return self.with_readings(table, read_by_gauges(rig, table, self.setup(rig), run))

    def setup(self, rig: Rig) -> SetUp:
        return SetUp(np.array(hemisphere_of(rig).centre_mm), np.zeros(1), np.eye(4), np.eye(4))

    def path(self, model: Model, table: H) -> Path:
        return stops(table.q, table.t_s)

    def read(self, model: Model, table: H, path: Path, scene: Scene, setup: SetUp) -> Array:
        """Return the reading of the gauge (m, 1) mm: distance between ball and tool less the radius."""
        to_tool = scene.T[:, :3, 3] - setup.ball
        sphere = hemisphere_frame(hemisphere_of(model.rig))
        contact = np.arctan2(to_tool @ sphere.v, to_tool @ sphere.u)
        scene = apply(model.effects, "setup", replace(scene, contact=contact))
        g_mm = (np.linalg.norm(to_tool, axis=1) - sphere.radius + scene.form_mm)[:, None]
        return gauged(model, path, scene, setup, g_mm)

    def unit_findings(self, table: H, rig: Rig, T_tool: Array) -> Iterable[Finding]:
        return target_units(table.g_mm, rig.tests.hemisphere.radius_mm) if rig.tests.hemisphere else ()

    def cannot_tell(self, table: H, rig: Rig) -> str:
        return "" if rig.tests.hemisphere else PLACE_UNKNOWN

    def judged_joints(self, table: H, rig: Rig) -> Verdict:
        return judged_by_path(table, rig)

    def off_path(self, table: H, rig: Rig, T_tool: Array) -> Off | None:
        hemisphere = rig.tests.hemisphere
        return off_targets(T_tool, self.targets(table, rig), hemisphere) if hemisphere else None

    def targets(self, table: H, rig: Rig) -> Array | None:
        hemisphere = rig.tests.hemisphere
        angles = self.directions(table, hemisphere) if hemisphere else None
        if hemisphere is None or angles is None:
            return None
        frame = hemisphere_frame(hemisphere)
        return np.asarray(frame.centre + frame.radius * frame.direction(*angles))

    def numbers_of(self, table: H) -> Integers:
        return table.target

    def rows_used(self, table: H, rig: Rig, where: str) -> Integers:
        hold_targets(table, rig, where)
        return np.arange(len(table.q))

    def angles_of(self, table: H, rig: Rig) -> tuple[Array, Array]:
        polar, azimuth = target_angles(hemisphere_of(rig))
        return polar[table.target - 1], azimuth[table.target - 1]


def hold_targets(table: TargetTable, rig: Rig, where: str) -> None:
    """Raise FileError for a target number outside the rig's hemisphere."""
    if rig.tests.hemisphere is None:
        return
    count = target_count(rig.tests.hemisphere)
    unknown = (table.target < 1) | (table.target > count)
    if unknown.any():
        row = int(np.argmax(unknown))
        what = f"target {table.target[row]} of row {row + 1} is not one of the {count} of the hemisphere"
        raise FileError(where, what, "correct target, or tests.hemisphere in the rig file")


def target_count(hemisphere: Hemisphere) -> int:
    """Return the number of targets of a hemisphere."""
    return len(target_angles(hemisphere)[0])


def another_visit(table: TargetTable, labels: Array) -> Mask:
    """Return a mask (n - 1,) of rows whose labels (n, k) or reading differ from the previous row."""
    return np.asarray((np.diff(labels, axis=0) != 0).any(axis=1) | (np.abs(np.diff(table.g_mm)) > STANDS_MM))


def timed(t_s: Array) -> dict[str, Array]:
    """Return the column of times t_s (n,) s, empty if all are zero."""
    return {"t_s": t_s} if t_s.any() else {}


def came_from_of(rows: Rows) -> Array | None:
    """Return the previous joint positions (n, axes) rad from the columns of a file, None if absent; a rail defaults to
    its present position."""
    names = came_from_columns(rows.axes)
    if not rows.has(names):
        return None
    return rows.with_rail(np.radians(rows.stack(names)), RAIL_FROM if rows.has((RAIL_FROM,)) else RAIL)


def came_from_cells(table: PlaceTable) -> dict[str, Array]:
    """Return the columns (n,) with the previous joint positions, in degrees and mm, empty if unknown."""
    if table.came_from is None:
        return {}
    return joint_cells(table.came_from, rail=table.rail, names=came_from_columns, rail_name=RAIL_FROM)


P = TypeVar("P", bound=PlaceTable)


class PlaceKind(Kind[P]):
    """Test of positions."""

    of_places = True
    example = ("rms_mm", 0.5, 1.0)

    def readings(self, table: P) -> Array:
        return table.xyz_mm

    def setup(self, rig: Rig) -> SetUp:
        return SetUp(np.zeros(3), np.zeros(1), np.eye(4), np.eye(4))

    def path(self, model: Model, table: P) -> Path:
        return visits(table.q, table.came_from)

    def sides(self, table: P) -> Integers | None:
        way = last_moves(table)
        if way is None:
            return None
        return np.where(np.abs(way) > SAME_RAD, np.sign(way), 0).astype(np.int64)

    def read(self, model: Model, table: P, path: Path, scene: Scene, setup: SetUp) -> Array:
        """Return T_instrument_target of the target, (m, 16) row by row."""
        T = setup.T_instrument_world @ path.at_readings(scene.T) @ setup.T_tool_target
        return T.reshape(-1, 16)

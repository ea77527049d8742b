"""Common parts of the kinds of tests at stops: one gauge at the targets of a hemisphere, or positions of postures."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable
from dataclasses import replace
from typing import ClassVar, TypeVar

import numpy as np

from analysis.procedures.checks.columns import PLACE_UNKNOWN, judged_by_path, off_targets
from analysis.procedures.checks.places import PLACE, place_findings
from analysis.procedures.checks.units import target_units
from analysis.procedures.shared.test_kind import Finders, Finding, PathDeviation, TestKind, Verdict
from analysis.robot.geometry.driven_programs import hemisphere_frame, hemisphere_of, target_angles
from analysis.robot.kinematics.arm import Array, Integers, Mask
from analysis.robot.predict import Model, ModelScene, Path, SetUp, apply, gauged, stops, visits
from analysis.runs.stands import STANDSTILL_MM, standstill_starts
from analysis.runs.tables import PlaceTable, TargetTable
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.declared_tests import Hemisphere

H = TypeVar("H", bound=TargetTable)
P = TypeVar("P", bound=PlaceTable)


class TargetTest(TestKind[H]):
    finders: ClassVar[Finders] = {PLACE: place_findings}

    @abstractmethod
    def directions(self, table: H, hemisphere: Hemisphere) -> tuple[Array, Array] | None: ...

    def setup(self, rig: Rig) -> SetUp:
        return SetUp(np.array(hemisphere_of(rig).centre_mm), np.zeros(1), np.eye(4), np.eye(4))

    def path(self, model: Model, table: H) -> Path:
        return stops(table.q, table.t_s)

    def read(self, model: Model, table: H, path: Path, scene: ModelScene, setup: SetUp) -> Array:
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

    def off_path(self, table: H, rig: Rig, T_tool: Array) -> PathDeviation | None:
        hemisphere = rig.tests.hemisphere
        return off_targets(T_tool, self.targets(table, rig), hemisphere) if hemisphere else None

    def targets(self, table: H, rig: Rig) -> Array | None:
        hemisphere = rig.tests.hemisphere
        angles = self.directions(table, hemisphere) if hemisphere else None
        if hemisphere is None or angles is None:
            return None
        frame = hemisphere_frame(hemisphere)
        return np.asarray(frame.centre + frame.radius * frame.direction(*angles))

    def rows_used(self, table: H, rig: Rig, where: str) -> Integers:
        require_known_targets(table, rig, where)
        return np.arange(len(table.q))

    def angles_of(self, table: H, rig: Rig) -> tuple[Array, Array]:
        polar, azimuth = target_angles(hemisphere_of(rig))
        return polar[table.target - 1], azimuth[table.target - 1]


class PlaceTest(TestKind[P]):
    def setup(self, rig: Rig) -> SetUp:
        return SetUp(np.zeros(3), np.zeros(1), np.eye(4), np.eye(4))

    def path(self, model: Model, table: P) -> Path:
        return visits(table.q, table.came_from)

    def read(self, model: Model, table: P, path: Path, scene: ModelScene, setup: SetUp) -> Array:
        # Both products are linear in the pose; a single matrix takes a third of the time of products pose by pose.
        both = np.multiply.outer(setup.T_instrument_world, setup.T_tool_target).transpose(1, 2, 0, 3).reshape(16, 16)
        return np.asarray(path.at_readings(scene.T).reshape(-1, 16) @ both)


def require_known_targets(table: TargetTable, rig: Rig, where: str) -> None:
    """Raise FileError for a target number outside the rig's hemisphere."""
    if rig.tests.hemisphere is None:
        return
    count = target_count(rig.tests.hemisphere)
    unknown = (table.target < 1) | (table.target > count)
    if unknown.any():
        row = int(np.argmax(unknown))
        problem = f"target {table.target[row]} of row {row + 1} is not one of the {count} of the hemisphere"
        remedy = "correct target, or tests.hemisphere in the rig file"
        raise FileError(where, problem, remedy, code="table.invalid")


def target_count(hemisphere: Hemisphere) -> int:
    return len(target_angles(hemisphere)[0])


def visit_starts(table: TargetTable, labels: Array) -> Mask:
    """Find the rows (n,) at which a new standstill starts; those up to the next belong to one visit.

    A standstill starts if the joints moved, or if the labels (n, k) or the reading differ from the previous row.
    """
    differs = (np.diff(labels, axis=0) != 0).any(axis=1) | (np.abs(np.diff(table.g_mm)) > STANDSTILL_MM)
    return standstill_starts(table.q, np.asarray(differs))

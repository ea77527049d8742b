"""Common checks of tests at the targets of a hemisphere."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable
from typing import TypeVar

import numpy as np

from analysis.procedures.checks.checks_of_test import Checks, Finders, PathDeviation, Verdict
from analysis.procedures.checks.finding import Finding
from analysis.procedures.checks.meanings import PLACE_UNKNOWN, judged_by_path
from analysis.procedures.checks.place import PLACE, off_targets, place_findings
from analysis.procedures.checks.units import target_units
from analysis.robot.geometry.hemisphere import hemisphere_frame, target_angles
from analysis.robot.kinematics.arm import Array
from analysis.runs.tables import TargetTable
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.declared_tests import Hemisphere

H = TypeVar("H", bound=TargetTable)


class TargetChecks(Checks[H]):
    """Checks of a test at targets."""

    @abstractmethod
    def directions(self, table: H, hemisphere: Hemisphere) -> tuple[Array, Array] | None:
        """Return polar angle and azimuth (n,) rad of each row's target; None if the hemisphere lacks a target."""

    @property
    def finders(self) -> Finders[H]:
        return ((PLACE, place_findings),)

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


def require_known_targets(table: TargetTable, rig: Rig, where: str) -> None:
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

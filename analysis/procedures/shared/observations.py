"""Usual observations of an arm by the table of a test, for a fit; including tests at targets and tests of positions.

A test with a different observation implements it as `PART` in the module `observe` of its package. The interface is
`Observation` in `analysis.diagnosis.evidence.observation_of`.
"""

from __future__ import annotations

from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from analysis.procedures.checks.lost_poses import Outliers
from analysis.procedures.shared.target_checks import require_known_targets
from analysis.robot.geometry.driven_programs import hemisphere_of
from analysis.robot.geometry.hemisphere import target_angles
from analysis.robot.kinematics.arm import Arm, Array, Integers
from analysis.robot.model.predict import Model
from analysis.runs.tables import SAME_RAD, Table, TargetTable
from rigs.rig import Rig
from rigs.schema.vocabulary import TestName

T = TypeVar("T", bound=Table)
H = TypeVar("H", bound=TargetTable)


class UsualObservation(Generic[T]):
    """Observation by all rows of a table; readings in the same posture repeat each other."""

    def __init__(self, test: TestName) -> None:
        self.test: TestName = test

    def rows_used(self, table: T, rig: Rig, where: str) -> Integers:
        """Return the numbers (m,) of the rows with explained readings. Raises FileError for a table of another rig."""
        return np.arange(len(table.q))

    def visits(self, table: T) -> Integers:
        """Return numbers (n, k) shared by readings of the same place, reached in the same way."""
        return np.round(table.q / SAME_RAD).astype(np.int64)

    def parts(self, table: T) -> NDArray[np.str_] | None:
        """Return the number of the part of each row (n,), if parts of a table have separate set-ups."""
        return None

    def outliers(self, table: T, arm: Arm) -> Outliers | None:
        """Return the rows far from all others, for places; other tests are compared with the calibrated arm only."""
        return None

    def doubts(self, table: T, model: Model, where: str) -> tuple[str, ...]:
        """Return doubts raised by a table compared with the arm alone, for the diagnosis to report."""
        return ()

    def angles_of(self, table: T, rig: Rig) -> tuple[Array, Array]:
        """Return polar angle and azimuth (n,) rad of each row on a map, nan if there is none."""
        nowhere = np.full(len(table.q), np.nan)
        return nowhere, nowhere


class TargetObservation(UsualObservation[H]):
    """Observation by readings at the targets of a hemisphere."""

    def rows_used(self, table: H, rig: Rig, where: str) -> Integers:
        require_known_targets(table, rig, where)
        return np.arange(len(table.q))

    def angles_of(self, table: H, rig: Rig) -> tuple[Array, Array]:
        polar, azimuth = target_angles(hemisphere_of(rig))
        return polar[table.target - 1], azimuth[table.target - 1]

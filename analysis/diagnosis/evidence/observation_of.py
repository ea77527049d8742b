"""Observation of an arm by the table of a test: the questions of a fit, which the package of the test answers."""

from __future__ import annotations

from functools import cache
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from analysis.procedures.checks.lost_poses import Outliers
from analysis.procedures.shared.observations import UsualObservation
from analysis.robot.kinematics.arm import Arm, Array, Integers
from analysis.robot.model.predict import Model
from analysis.runs.parts_of_tests import part_of
from analysis.runs.tables import Table
from rigs.rig import Rig
from rigs.schema.vocabulary import TestName

T_contra = TypeVar("T_contra", bound=Table, contravariant=True)


class Observation(Protocol[T_contra]):
    """Observation of an arm by a table, for a fit. `UsualObservation` gives the common answers."""

    def rows_used(self, table: T_contra, rig: Rig, where: str) -> Integers:
        """Return the numbers (m,) of the rows with explained readings. Raises FileError for a table of another rig."""

    def visits(self, table: T_contra) -> Integers:
        """Return numbers (n, k) shared by readings of the same place, reached in the same way."""

    def parts(self, table: T_contra) -> NDArray[np.str_] | None:
        """Return the number of the part of each row (n,), if parts of a table have separate set-ups."""

    def outliers(self, table: T_contra, arm: Arm) -> Outliers | None:
        """Return the rows far from all others, for places; other tests are compared with the calibrated arm only."""

    def doubts(self, table: T_contra, model: Model, where: str) -> tuple[str, ...]:
        """Return doubts raised by a table compared with the arm alone, for the diagnosis to report."""

    def angles_of(self, table: T_contra, rig: Rig) -> tuple[Array, Array]:
        """Return polar angle and azimuth (n,) rad of each row on a map, nan if there is none."""


def observation_of(table: Table) -> Observation[Table]:
    """Return the observation of an arm by a table. Raises FileError if the package of its test is unusable."""
    return _observation(table.test)


@cache
def _observation(test: TestName) -> Observation[Table]:
    return part_of(test, "observe", UsualObservation[Table])

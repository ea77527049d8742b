"""Evaluate a table of any test, measured or simulated; with the common checks, each with a one-line error and
remedy.

Each test implements `Evaluation` as `PART` in the module `evaluate` of its package.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Protocol, TypeVar

import numpy as np

from analysis.robot.kinematics.arm import Array
from analysis.robot.kinematics.joint_limits import impossible_rad
from analysis.runs.noise.spectrum import LapNoise
from analysis.runs.parts_of_tests import TestPart, part_of
from analysis.runs.tables import Table
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.vocabulary import Direction, TestName

if TYPE_CHECKING:
    from analysis.procedures.shared.quantity import Quantity
    from analysis.procedures.shared.reduction import Reduced
    from analysis.procedures.shared.result_curves import ResultCurve
    from analysis.procedures.shared.simulated_gauges import Simulation

T = TypeVar("T", bound=Table)


class Evaluated(Protocol):
    """Result of a test: figures by name, number of samples, notes, and the underlying curve or points."""

    @property
    def figures(self) -> Mapping[str, Quantity]: ...
    @property
    def samples(self) -> int: ...
    @property
    def notes(self) -> tuple[str, ...]: ...
    @property
    def as_curve(self) -> ResultCurve: ...


@dataclass(frozen=True)
class Instruments:
    """Information about the instruments outside the table.

    u_lag_s: standard uncertainty of the gauges' time relative to the joints'. u_gauge_mm: of one reading, from the rig
    file if None. like: noise of angle and distance in a different run, for a circle of a single lap. reduced: all
    readings of a circle whose table is thinned.
    """

    u_lag_s: float = 0.0
    u_gauge_mm: float | None = None
    like: tuple[LapNoise, LapNoise] | None = None
    reduced: Reduced | None = None

    def u_mm(self, rig: Rig) -> float:
        """Return the standard uncertainty of one gauge reading."""
        return rig.gauges.g1.accuracy_mm if self.u_gauge_mm is None else self.u_gauge_mm


class Evaluation(TestPart, Protocol[T]):
    """Figures of a test, from a measured or a simulated table."""

    @abstractmethod
    def evaluate(self, table: T, rig: Rig, where: str, instruments: Instruments) -> Evaluated:
        """Return the figures. Raises FileError if a table is not a valid measurement."""

    def require_evaluable(self, table: T, rig: Rig, where: str) -> None:
        """Raise FileError if an evaluation will refuse the table for an immediately visible reason, gauges excluded."""

    def simulated(self, rig: Rig, direction: Direction | None, run: Simulation) -> T:
        """Return a run as it would be measured. Raises FileError if the robot cannot do the test."""
        raise FileError(f"{self.test} test", "is not simulated", "simulate a different test")


@cache
def evaluation_of(test: TestName) -> Evaluation[Table]:
    """Return the evaluation of a test. Raises FileError if its package is unusable."""
    return part_of(test, "evaluate")


def evaluate(
    table: Table,
    rig: Rig,
    u_lag_s: float,
    where: str,
    u_gauge_mm: float | None = None,
    like: tuple[LapNoise, LapNoise] | None = None,
    reduced: Reduced | None = None,
) -> Evaluated:
    """Return the figures of a table, with information about its instruments (`Instruments`).

    Raises FileError if the table is not a valid measurement of its test.
    """
    instruments = Instruments(u_lag_s, u_gauge_mm, like, reduced)
    return evaluation_of(table.test).evaluate(table, rig, where, instruments)


def check_joints(where: str, q: Array, remedy: str) -> None:
    """Raise FileError with the remedy if joints q (n, axes) rad never moved, or have a different unit."""
    if np.ptp(q, axis=0).max() < 1e-6:
        raise FileError(where, "the robot stood still in all rows", remedy)
    if most := impossible_rad(q):
        angle = f"a joint at {np.degrees(most):.0f}° is impossible"
        raise FileError(where, angle, "check the unit of q: files hold degrees")


def check_numbers(where: str, **columns: Array) -> None:
    """Raise FileError if a column (n, …) contains a value that is not a number."""
    for name, values in columns.items():
        if np.isfinite(values).all():
            continue
        bad = np.asarray(~np.isfinite(values.reshape(len(values), -1)).all(axis=1))
        if bad.all():
            problem = f"{name} contains no valid number in any of the {len(bad)} rows"
            raise FileError(where, problem, "check that the instrument measures and sends, and repeat the measurement")
        row = int(np.argmax(bad)) + 1
        raise FileError(where, f"{name} of row {row} is not a number ({bad.sum()} such rows)", "remove such rows")


def require_live_gauges(where: str, **readings: Array) -> None:
    """Raise FileError if a gauge has constant readings: real gauges never do."""
    for name, values in readings.items():
        if len(values) > 1 and np.ptp(values) == 0:
            remedy = "check that the gauge touches and sends (a simulation needs noise), and repeat the measurement"
            raise FileError(where, f"{name} reads {values[0]:g} mm in all {len(values)} rows", remedy)


def check_radius(where: str, radius_mm: float) -> None:
    """Raise FileError for a radius that is not a positive number."""
    if not (np.isfinite(radius_mm) and radius_mm > 0):
        raise FileError(where, f"a radius of {radius_mm:g} mm is impossible", "correct radius_mm in the rig file")

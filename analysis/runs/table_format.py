"""Kinds of tests: the interface of a test, and the import of implementations.

Code that processes a table calls `table.kind` and never compares kinds. The implementation is the module `evaluate` in
the folder of `analysis.procedures` with the test's name (yaw and roll share `circle`). It covers all aspects of a test,
from the columns of a file to the fitted terms of a set-up, and no other code names a test. Common parts are in
`shared/places_and_targets`, `shared/evaluate` and `circle/evaluate`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Generic, TypeVar, cast, get_args

import numpy as np

from rigs.errors import FileError
from rigs.schema.vocabulary import OFFERED_TESTS, TestName

if TYPE_CHECKING:
    import pyarrow as pa
    from numpy.typing import NDArray

    from analysis.procedures.checks.finding import Finding
    from analysis.procedures.checks.lost_poses import Far
    from analysis.procedures.checks.meanings import Verdict
    from analysis.procedures.checks.place import Off
    from analysis.procedures.shared.evaluate import Evaluated, Instruments
    from analysis.procedures.shared.simulated_gauges import Simulation
    from analysis.robot.kinematics.arm import Arm, Array, Integers, Mask
    from analysis.robot.model.predict import Model, Path, SetUp
    from analysis.robot.model.scene import Scene
    from analysis.runs.align import Aligned
    from analysis.runs.csv_tables import Rows
    from analysis.runs.table_layout import Layout
    from analysis.runs.tables import Table
    from rigs.rig import Rig
    from rigs.schema.effect import Gauge
    from rigs.schema.vocabulary import Direction

T = TypeVar("T", bound="Table")
SAME_RAD = 3e-4
"""Largest difference of each joint angle between equal postures, three steps of angles reported by controllers."""


class Kind(ABC, Generic[T]):
    """Interface of a test. The base class implements the common behaviour, which tests override."""

    gauges: tuple[Gauge, ...] = ()
    """Gauges used by the test."""
    certified: tuple[str, ...] = ()
    """Parts of the rig file that determine the readings and may have a certificate: gauges, ball, link."""

    example: tuple[str, float, float] | None = None
    """Example of a figure with bounds for warning and failure, to be replaced by the user. The values are of the
    size of those in docs/rig-file.md.
    """
    part = ""
    """Section of `tests` in a rig file that describes location and motion of the test."""
    further: tuple[str, str] | None = None
    """Name of the additional test in a plan, for a rig file with that section, and the reason for adding it."""
    along = "place"
    """Abscissa of the curve in a table of measured and simulated values."""

    in_order_of_time = False
    """True if the times of rows increase."""
    swept = False
    """True if joints move during a reading."""
    of_places = False
    """True if a reading is a position: three coordinates of a target or ball on the tool."""
    of_tracker = False
    """True if a tracker measures the positions. It may be placed anywhere, and may read joints before they rest."""
    constants_apart = False
    """True if the readings alone determine the constants of an arm. The constants then have separate widths."""
    setup_terms, frame_terms = 4, 0
    """Number of fitted set-up terms, and number of leading terms that belong to the instrument or socket. For
    positions, the remaining terms belong to the target on the tool and are common to all placements.
    """
    setup_words = "the ball's position and the gauges' zeros"
    """Description of the set-up terms in messages."""
    wild_spreads = 10.0
    """Threshold of an outlier relative to a calibrated arm, in robust standard deviations. The standard deviation is
    at least the largest of real cells, 0.06 mm. Chosen: equal to that for the sphere of a radial test.
    """
    assumed_sd_mm = np.nan
    """Standard deviation of a coordinate if no position was visited twice."""
    never_twice = ""
    """Message if no reading was repeated. Empty if the message common to all tests applies."""
    finders: tuple[tuple[str, Callable[[T, Rig], Iterable[Finding]]], ...] = ()
    """Conventions that only a few tests can violate, each with the function that finds violations."""
    joints_fit = "rows lie on the path of the test"
    rows_called = "targets"
    away_from = ""
    when_far = ""
    """Words for messages: verb phrase of plausible rows, name of a row, origin of the distance, and advice."""
    without_joints = ""
    """Reason why the test does not show single joints. Empty if it does."""

    def __init__(self, test: TestName) -> None:
        self.test: TestName = test

    def refused(self, where: str) -> FileError:
        """Return the error for a test that does not show the joints of an arm."""
        return FileError(where, self.without_joints, "give poses, touches or circles")

    @abstractmethod
    def layout(self, axes: int = 6, *, rail: bool = False) -> Layout:
        """Return the columns of the table for an arm with this number of axes, with or without a rail."""

    @abstractmethod
    def table_of(self, rows: Rows, direction: Direction | None, where: str) -> T:
        """Convert the columns of a file to a table. Raises FileError."""

    @abstractmethod
    def columns(self, table: T) -> Mapping[str, Array | Integers | Sequence[str] | pa.Array]:
        """Return the columns (n,) of docs/tables.md by name, in the documented order, in degrees and mm."""

    @abstractmethod
    def readings(self, table: T) -> Array:
        """Return the readings (n, k) in mm: a column for each gauge, or three coordinates."""

    def differs(self, table: T) -> Mask | None:
        """Return a mask (n - 1,) of rows with labels or readings that differ from the previous row,
        ignoring the joints.

        None if rows are never repeated readings of one standstill, because the robot was moving or because each row is
        a separate visit.
        """
        return None

    def averaged(self, table: T, first: Mask, mean: Callable[[Array], Array]) -> T:
        """Return the table with one row per standstill; `differs` separates standstills.

        first (n,): mask of the first row of each standstill. mean: function that averages values (n, …) over each
        standstill, to (s, …) in the same unit. Labels are taken from the first row.
        """
        columns = {name: column for name, column in vars(table).items() if isinstance(column, np.ndarray)}
        return replace(table, **{name: mean(c) if c.dtype.kind == "f" else c[first] for name, c in columns.items()})

    def recorded(self, data: Aligned, rig: Rig, direction: Direction | None, where: str) -> tuple[T, list[str]]:
        """Convert a recorded run to a table, and return it with the doubts as text. Raises FileError."""
        raise FileError(where, f"a recorded {self.test} run has no instrument to read", "import its table: rig import")

    # ------------------------------------------------------------------------------------------------------------------
    # Prediction of the table by the model.

    def setup(self, rig: Rig) -> SetUp:
        """Return the nominal set-up: ball at the nominal centre, gauges at zero, instrument in the world frame."""
        raise self.refused(f"rig {rig.name}")

    def path(self, model: Model, table: T) -> Path:
        """Return the motion of a table: as recorded, or with the approaches prescribed by the test."""
        raise self.refused(f"rig {model.rig.name}")

    def read(self, model: Model, table: T, path: Path, scene: Scene, setup: SetUp) -> Array:
        """Return readings (m, k): gauges in mm, or for positions the poses T_instrument_target as rows (m, 16)."""
        raise self.refused(f"rig {model.rig.name}")

    def with_readings(self, table: T, values: Array) -> T:
        """Return the table with the gauge readings replaced by values (n, k) mm."""
        raise self.refused(f"a {self.test} table")

    def simulated(self, rig: Rig, direction: Direction | None, run: Simulation) -> T:
        """Simulate a run of the test. Raises FileError if the robot cannot do the test."""
        raise FileError(f"{self.test} test", "is not simulated", "simulate another test")

    # ------------------------------------------------------------------------------------------------------------------
    # Evidence against the labelled meaning of columns.

    def findings(self, convention: str, table: T, rig: Rig) -> Iterable[Finding]:
        """Return the violations of a convention in a table, according to `finders`."""
        find = dict(self.finders).get(convention)
        return find(table, rig) if find else ()

    def unit_findings(self, table: T, rig: Rig, T_tool: Array) -> Iterable[Finding]:
        """Return evidence against the units, strongest first, relative to nominal tool poses T_tool (n, 4, 4)."""
        return ()

    def cannot_tell(self, table: T, rig: Rig) -> str:
        """Return the reason if a table cannot show the meaning of the joint columns. Empty if it can."""
        return self.without_joints

    def judged_joints(self, table: T, rig: Rig) -> Verdict:
        """Determine the meaning of the joint columns, for a table that can show it."""
        raise self.refused(f"rig {rig.name}")

    def off_path(self, table: T, rig: Rig, T_tool: Array) -> Off | None:
        """Return the distance of tool poses T_tool (n, 4, 4) from the nominal path of the test, None if unknown."""
        return None

    def targets(self, table: T, rig: Rig) -> Array | None:
        """Return the target positions (n, 3) mm of the rows, or None if the rig file does not contain them."""
        return None

    def numbers_of(self, table: T) -> Integers:
        """Return the number (n,) of each row as displayed to the user: row in the file, or target."""
        return table.rows

    def thinned(self, table: T, count: int) -> T:
        """Reduce a table of millions of rows to about `count` rows. Shorter tables are not changed."""
        return table

    # ------------------------------------------------------------------------------------------------------------------
    # Figures of the test.

    @abstractmethod
    def evaluate(self, table: T, rig: Rig, where: str, instruments: Instruments) -> Evaluated:
        """Evaluate the figures. Raises FileError if a table is not a valid measurement."""

    def hold_evaluable(self, table: T, rig: Rig, where: str) -> None:
        """Raise FileError if evaluation would refuse the table for an obvious reason. Gauges are not checked."""

    # ------------------------------------------------------------------------------------------------------------------
    # Use of the test in a fit of the arm.

    def rows_used(self, table: T, rig: Rig, where: str) -> Integers:
        """Return the indices (m,) of the rows used in a fit.
        Raises FileError if the table belongs to a different rig.
        """
        return np.arange(len(table.q))

    def direction(self, table: T) -> Direction | None:
        """Return the direction of the motion, or None for a test with only one."""
        return None

    def visits(self, table: T) -> Integers:
        """Return labels (n, k): rows with equal numbers are readings of the same position, reached in the same way."""
        return np.round(table.q / SAME_RAD).astype(np.int64)

    def parts(self, table: T) -> NDArray[np.str_] | None:
        """Return the part of each row (n,) as text without a unit, or None if the table has a single set-up."""
        return None

    def sides(self, table: T) -> Integers | None:
        """Return the side of the backlash of each joint (n, axes):
        direction of the last move, -1 or 1, or 0 if not moved.

        None if rows do not contain the approach of the joints.
        """
        return None

    def far(self, table: T, arm: Arm) -> Far | None:
        """Return the rows of a position table that are far from all others. Other tests are compared with the
        calibrated arm only.
        """
        return None

    def lost(self, table: T) -> Mask:
        """Return a mask (n,) of the rows without a measurement, recognised by the value that the instrument writes."""
        return np.zeros(len(table.q), dtype=bool)

    def doubts(self, table: T, model: Model, where: str) -> tuple[str, ...]:
        """Return doubts about a table compared with a model of the arm without effects, for the diagnosis."""
        return ()

    def angles_of(self, table: T, rig: Rig) -> tuple[Array, Array]:
        """Return polar angle and azimuth (n,) rad of each row on a map, nan if it has none."""
        nowhere = np.full(len(table.q), np.nan)
        return nowhere, nowhere


@cache
def kind_named(test: TestName) -> Kind[Table]:
    """Return the kind of a test: KIND of the module in `analysis.procedures`, or of a package that provides it.

    Packages provide tests as entry points `rig.tests`. Raises FileError if an entry point is invalid.
    """
    offer = OFFERED_TESTS.get(test)
    if offer is None:
        package = f"analysis.procedures.{test}"
        module = f"{package}.evaluate" if find_spec(package) else f"analysis.procedures.circle.{test}"
        return cast("Kind[Table]", import_module(module).KIND)
    why = f"it is no {Kind.__name__}"
    try:
        kind = offer.load()
        if isinstance(kind, Kind):
            return kind
    except Exception as reason:  # noqa: BLE001 - whatever a foreign module raises as it is imported
        why = str(reason)
    remedy = "install another version of that package, or uninstall it"
    raise FileError(f"test {test}", f"{offer.value}, which a package offers, cannot be used: {why}", remedy)


def kinds() -> Iterator[Kind[Table]]:
    """Return all kinds of tests, in the order used everywhere."""
    return map(kind_named, get_args(TestName))

"""Kinds of tests: the interface of a test, and the place of each implementation.

Code with a table calls `table.kind` and never compares kinds. A kind is `evaluate` in the folder of
`analysis.procedures` with the test's name (yaw and roll share `circle`), and no other code names it. It covers
everything from the columns of a file to the fitted part of a set-up. Common parts are in `places_and_targets` and
`evaluate` of `shared`, and in `evaluate` of `circle`.
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
"""Joint angles that all differ by less than this count as the same posture. Controllers report angles in steps of about
a third of it."""


class Kind(ABC, Generic[T]):
    """Interface of a test. The base class contains the common answers; a test overrides the different ones."""

    gauges: tuple[Gauge, ...] = ()
    """The gauges that it is read with."""
    certified: tuple[str, ...] = ()
    """Parts of the rig file that may have a certificate and determine the readings: gauges, ball, link."""

    example: tuple[str, float, float] | None = None
    """Example figure with bounds for warning and failure, of the size of the values in docs/rig-file.md, to be
    replaced."""
    part = ""
    """Section of `tests` in a rig file describing place and motion of the test."""
    further: tuple[str, str] | None = None
    """Name in a plan as an additional test in a rig file with that section, and the reason for adding it."""
    along = "place"
    """Abscissa of the curve in a table of measured and simulated values."""

    in_order_of_time = False
    """Whether rows have increasing times."""
    swept = False
    """Whether joints move during the reading."""
    of_places = False
    """Whether a reading is a place, three coordinates of a target or ball on the tool."""
    of_tracker = False
    """Whether an instrument sees the places; it may be placed anywhere and may read joints before they rest."""
    constants_apart = False
    """Whether the readings alone determine the constants of an arm, which then have separate widths."""
    setup_terms, frame_terms = 4, 0
    """Number of fitted set-up terms, and number of leading terms for places that belong to the instrument or socket;
    the others belong to the target on the tool, common to all placements."""
    setup_words = "the ball's position and the gauges' zeros"
    """Description of the set-up terms."""
    wild_spreads = 10.0
    """Robust standard deviations from which a reading is an outlier relative to a calibrated arm; the standard
    deviation is at least the largest of real cells, 0.06 mm. Chosen: as for the sphere of a radial test."""
    assumed_sd_mm = np.nan
    """Standard deviation of a coordinate if no place was visited twice."""
    never_twice = ""
    """Message if no reading was repeated; empty if the message is common to all tests."""
    finders: tuple[tuple[str, Callable[[T, Rig], Iterable[Finding]]], ...] = ()
    """Conventions that few tests can break, each with the function finding violations."""
    joints_fit = "rows lie on the path of the test"
    rows_called = "targets"
    away_from = ""
    when_far = ""
    """Words: action of rows whose joints have the labelled meaning; name of a row; origin of the distance; subject
    to check."""
    without_joints = ""
    """Reason for not showing single joints; empty if the test does show them."""

    def __init__(self, test: TestName) -> None:
        self.test: TestName = test

    def refused(self, where: str) -> FileError:
        """Return the error for a test showing nothing of an arm's joints."""
        return FileError(where, self.without_joints, "give poses, touches or circles")

    @abstractmethod
    def layout(self, axes: int = 6, *, rail: bool = False) -> Layout:
        """Return the columns of the table for an arm with this number of axes, on a rail or not."""

    @abstractmethod
    def table_of(self, rows: Rows, direction: Direction | None, where: str) -> T:
        """Return the table of the columns of a file. Raises FileError."""

    @abstractmethod
    def columns(self, table: T) -> Mapping[str, Array | Integers | Sequence[str] | pa.Array]:
        """Return the columns (n,) of docs/tables.md by name, in the documented order: degrees and mm."""

    @abstractmethod
    def readings(self, table: T) -> Array:
        """Return the readings (n, k), in mm: a column for each gauge, or three coordinates."""

    def differs(self, table: T) -> Mask | None:
        """Return a mask (n - 1,) of rows differing from the previous row, whatever the joints; None if a row is never
        a second reading of the same standstill: the robot was driven, or each row is a separate visit."""
        return None

    def averaged(self, table: T, first: Mask, mean: Callable[[Array], Array]) -> T:
        """Return the table with a row for each standstill separated by `differs`; first (n,): whether a row is the
        first of a standstill, mean: means (s, …) over each standstill of values (n, …) in their unit; labels are
        those of the first row."""
        columns = {name: column for name, column in vars(table).items() if isinstance(column, np.ndarray)}
        return replace(table, **{name: mean(c) if c.dtype.kind == "f" else c[first] for name, c in columns.items()})

    def recorded(self, data: Aligned, rig: Rig, direction: Direction | None, where: str) -> tuple[T, list[str]]:
        """Return the table of a recorded run, and doubts in words. Raises FileError."""
        raise FileError(where, f"a recorded {self.test} run has no instrument to read", "import its table: rig import")

    # ------------------------------------------------------------------------------------------------------------------
    # Model prediction of the table.

    def setup(self, rig: Rig) -> SetUp:
        """Return the nominal set-up: ball in the nominal centre, gauges at zero, instrument in the world frame."""
        raise self.refused(f"rig {rig.name}")

    def path(self, model: Model, table: T) -> Path:
        """Return the motion behind a table: as recorded, or with the approaches that the test prescribes."""
        raise self.refused(f"rig {model.rig.name}")

    def read(self, model: Model, table: T, path: Path, scene: Scene, setup: SetUp) -> Array:
        """Return readings (m, k): gauges in mm; for places T_instrument_target, (m, 16) row by row."""
        raise self.refused(f"rig {model.rig.name}")

    def with_readings(self, table: T, values: Array) -> T:
        """Return the table with other readings (n, k) mm, of gauges."""
        raise self.refused(f"a {self.test} table")

    def simulated(self, rig: Rig, direction: Direction | None, run: Simulation) -> T:
        """Return a run as it would be measured. Raises FileError if the robot cannot do the test."""
        raise FileError(f"{self.test} test", "is not simulated", "simulate a different test")

    # ------------------------------------------------------------------------------------------------------------------
    # Evidence against the labelled meaning of the columns.

    def findings(self, convention: str, table: T, rig: Rig) -> Iterable[Finding]:
        """Return the findings of a table against a convention, by `finders`."""
        find = dict(self.finders).get(convention)
        return find(table, rig) if find else ()

    def unit_findings(self, table: T, rig: Rig, T_tool: Array) -> Iterable[Finding]:
        """Return the findings against units, relative to nominal tool poses T_tool (n, 4, 4), the most certain
        first."""
        return ()

    def cannot_tell(self, table: T, rig: Rig) -> str:
        """Return the reason why a table cannot show the meaning of the joint columns; empty if it can."""
        return self.without_joints

    def judged_joints(self, table: T, rig: Rig) -> Verdict:
        """Return which meaning of the joint columns fits a table that can show it."""
        raise self.refused(f"rig {rig.name}")

    def off_path(self, table: T, rig: Rig, T_tool: Array) -> Off | None:
        """Return the distance of tool poses T_tool (n, 4, 4) from the nominal path of the test; None if unknown."""
        return None

    def targets(self, table: T, rig: Rig) -> Array | None:
        """Return the target places (n, 3) mm of the rows; None if the rig file does not contain them."""
        return None

    def numbers_of(self, table: T) -> Integers:
        """Return the number (n,) identifying each row to the user: row in the file, or target."""
        return table.rows

    def thinned(self, table: T, count: int) -> T:
        """Return a table of about `count` rows at most if the test may have millions; others are short."""
        return table

    # ------------------------------------------------------------------------------------------------------------------
    # Figures of the test.

    @abstractmethod
    def evaluate(self, table: T, rig: Rig, where: str, instruments: Instruments) -> Evaluated:
        """Return the figures. Raises FileError if a table is not a valid measurement."""

    def hold_evaluable(self, table: T, rig: Rig, where: str) -> None:
        """Raise FileError if an evaluation will refuse the table for an immediately visible reason, gauges excluded."""

    # ------------------------------------------------------------------------------------------------------------------
    # Observation of an arm by the test in a fit.

    def rows_used(self, table: T, rig: Rig, where: str) -> Integers:
        """Return the numbers (m,) of the rows with explained readings. Raises FileError for a table of another rig."""
        return np.arange(len(table.q))

    def direction(self, table: T) -> Direction | None:
        """Return in which direction it was driven, of a test that is driven in two."""
        return None

    def visits(self, table: T) -> Integers:
        """Return numbers (n, k) shared by readings of the same place, reached in the same way."""
        return np.round(table.q / SAME_RAD).astype(np.int64)

    def parts(self, table: T) -> NDArray[np.str_] | None:
        """Return the number of the part of each row (n,), if parts of a table have separate set-ups."""
        return None

    def sides(self, table: T) -> Integers | None:
        """Return the side of the backlash for each joint (n, axes): direction of the last move, -1 or 1, 0 if the
        joint did not move; None if rows do not contain the approach of the joints."""
        return None

    def far(self, table: T, arm: Arm) -> Far | None:
        """Return the rows far from all others, for places; other tests are compared with the calibrated arm only."""
        return None

    def lost(self, table: T) -> Mask:
        """Return a mask (n,) of the rows without a measurement, by the value that an instrument writes in that case."""
        return np.zeros(len(table.q), dtype=bool)

    def doubts(self, table: T, model: Model, where: str) -> tuple[str, ...]:
        """Return doubts raised by a table compared with the arm alone, for the diagnosis to report."""
        return ()

    def angles_of(self, table: T, rig: Rig) -> tuple[Array, Array]:
        """Return polar angle and azimuth (n,) rad of each row on a map, nan if there is none."""
        nowhere = np.full(len(table.q), np.nan)
        return nowhere, nowhere


@cache
def kind_named(test: TestName) -> Kind[Table]:
    """Return the kind of a test: KIND of the module in `analysis.procedures`, or the offer of a package as
    `rig.tests` under that name. Raises FileError for an invalid offer."""
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
    remedy = "install a different version of that package, or uninstall it"
    raise FileError(f"test {test}", f"{offer.value}, which a package offers, cannot be used: {why}", remedy)


def kinds() -> Iterator[Kind[Table]]:
    """Return every kind of test, in the order in which they are named everywhere."""
    return map(kind_named, get_args(TestName))

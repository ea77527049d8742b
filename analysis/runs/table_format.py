"""A kind of test: every question that rig asks of one, and where its answers stand.

Code that has a table asks `table.kind`, and never which kind it is: a kind is `evaluate` in the folder of
`analysis.procedures` with the test's name (yaw and roll share `circle`), and nothing else names it. It answers from
the columns of a file to the part of a set-up that is fitted; what several tests have in common, `places_and_targets`
in `shared` and `evaluate` in `circle` answer.
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
    """What a test is to rig. Answers that most tests share stand here; a test overrides those that it has otherwise."""

    gauges: tuple[Gauge, ...] = ()
    """The gauges that it is read with."""
    certified: tuple[str, ...] = ()
    """What of the rig file may have a certificate, and decides its readings: gauges, ball, link."""

    example: tuple[str, float, float] | None = None
    """One of its figures, and bounds from which it is watched and fails, of the size of those in docs/rig-file.md:
    examples, to be replaced."""
    part = ""
    """The part of `tests` in a rig file that says where and how it is driven."""
    further: tuple[str, str] | None = None
    """What a plan calls it as a further test in a rig file with that part, and why it adds something."""
    along = "place"
    """What its curve runs along, in a table of measured and simulated."""

    in_order_of_time = False
    """Whether its rows have times, which increase."""
    swept = False
    """Whether joints move while it is read."""
    of_places = False
    """Whether a reading is a place, three coordinates of a target or ball on the tool."""
    of_tracker = False
    """Whether an instrument sees the places, which stands anywhere and may read joints before they rest."""
    constants_apart = False
    """Whether its readings alone show an arm's constants, which then have widths of their own."""
    setup_terms, frame_terms = 4, 0
    """How many numbers of its set-up are fitted, and how many first ones of them, of places, are those of instrument or
    socket; the others are those of the target on the tool, which placements share."""
    setup_words = "the ball's position and the gauges' zeros"
    """What these are."""
    wild_spreads = 10.0
    """Robust standard deviations from which a reading is wild beside a calibrated arm; they are taken to be at least
    the largest of real cells, 0.06 mm. Chosen: as for the sphere of a radial test."""
    assumed_sd_mm = np.nan
    """Standard deviation of a coordinate where no place was visited twice."""
    never_twice = ""
    """What to say where no reading was repeated; empty where it is said with all tests."""
    finders: tuple[tuple[str, Callable[[T, Rig], Iterable[Finding]]], ...] = ()
    """Conventions that few tests can break, each with what looks for findings about it."""
    joints_fit = "rows lie on the path of the test"
    rows_called = "targets"
    away_from = ""
    when_far = ""
    """Words: what rows do whose joints mean what they are called; what a row is; from where one is far; what to check
    then."""
    without_joints = ""
    """Why it shows nothing of single joints; empty where it does."""

    def __init__(self, test: TestName) -> None:
        self.test: TestName = test

    def refused(self, where: str) -> FileError:
        """Return the error for whom it shows nothing of an arm's joints."""
        return FileError(where, self.without_joints, "give poses, touches or circles")

    @abstractmethod
    def layout(self, axes: int = 6, *, rail: bool = False) -> Layout:
        """Return the columns of its table for an arm of so many axes, on a rail or not."""

    @abstractmethod
    def table_of(self, rows: Rows, direction: Direction | None, where: str) -> T:
        """Return the table of the columns of a file. Raises FileError."""

    @abstractmethod
    def columns(self, table: T) -> Mapping[str, Array | Integers | Sequence[str] | pa.Array]:
        """Return the columns (n,) of docs/tables.md by name, in its order: degrees and mm."""

    @abstractmethod
    def readings(self, table: T) -> Array:
        """Return what was read (n, k), in mm: a column for each gauge, or three coordinates."""

    def differs(self, table: T) -> Mask | None:
        """Return which rows (n - 1,) are something else than the row before, whatever the joints; None where a row is
        never a second reading of one stand: the robot was driven, or each row is a visit by itself."""
        return None

    def averaged(self, table: T, first: Mask, mean: Callable[[Array], Array]) -> T:
        """Return the table with a row for each stand, of those that `differs` separates; first (n,): whether a row
        begins one, mean: means (s, …) over each stand of values (n, …) in their unit; labels are those of the first."""
        columns = {name: column for name, column in vars(table).items() if isinstance(column, np.ndarray)}
        return replace(table, **{name: mean(c) if c.dtype.kind == "f" else c[first] for name, c in columns.items()})

    def recorded(self, data: Aligned, rig: Rig, direction: Direction | None, where: str) -> tuple[T, list[str]]:
        """Return the table of a recorded run, and doubts in words. Raises FileError."""
        raise FileError(where, f"a recorded {self.test} run has no instrument to read", "import its table: rig import")

    # ------------------------------------------------------------------------------------------------------------------
    # What a model predicts of it.

    def setup(self, rig: Rig) -> SetUp:
        """Return the nominal set-up: ball in its place, gauges at zero, instrument in the world's frame."""
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
        """Return one run as it would be measured. Raises FileError where the robot cannot do the test."""
        raise FileError(f"{self.test} test", "is not simulated", "simulate another test")

    # ------------------------------------------------------------------------------------------------------------------
    # What speaks against its columns being what they are called.

    def findings(self, convention: str, table: T, rig: Rig) -> Iterable[Finding]:
        """Return what speaks against a convention in a table, of those that `finders` look at."""
        find = dict(self.finders).get(convention)
        return find(table, rig) if find else ()

    def unit_findings(self, table: T, rig: Rig, T_tool: Array) -> Iterable[Finding]:
        """Return what speaks against units, beside nominal tool poses T_tool (n, 4, 4), surest first."""
        return ()

    def cannot_tell(self, table: T, rig: Rig) -> str:
        """Return why a table cannot show what its joint columns mean; empty where it can."""
        return self.without_joints

    def judged_joints(self, table: T, rig: Rig) -> Verdict:
        """Return which meaning of the joint columns fits a table that can show it."""
        raise self.refused(f"rig {rig.name}")

    def off_path(self, table: T, rig: Rig, T_tool: Array) -> Off | None:
        """Return how far tool poses T_tool (n, 4, 4) lie from where the test has them; None where that is unknown."""
        return None

    def targets(self, table: T, rig: Rig) -> Array | None:
        """Return the places (n, 3) mm to which the rows were to go; None where the rig file does not say it."""
        return None

    def numbers_of(self, table: T) -> Integers:
        """Return the number (n,) by which a person knows what each row is of: its row in the file, or its target."""
        return table.rows

    def thinned(self, table: T, count: int) -> T:
        """Return a table of some `count` rows at the most, where the test may have millions; others are short."""
        return table

    # ------------------------------------------------------------------------------------------------------------------
    # What it measures.

    @abstractmethod
    def evaluate(self, table: T, rig: Rig, where: str, instruments: Instruments) -> Evaluated:
        """Return its figures. Raises FileError where a table is not a valid measurement."""

    def hold_evaluable(self, table: T, rig: Rig, where: str) -> None:
        """Raise FileError for what an evaluation will refuse, where that is seen at once: gauges apart."""

    # ------------------------------------------------------------------------------------------------------------------
    # How a fit observes an arm by it.

    def rows_used(self, table: T, rig: Rig, where: str) -> Integers:
        """Return the numbers (m,) of the rows whose readings are explained. Raises FileError for a table of
        another rig."""
        return np.arange(len(table.q))

    def direction(self, table: T) -> Direction | None:
        """Return in which direction it was driven, of a test that is driven in two."""
        return None

    def visits(self, table: T) -> Integers:
        """Return integers (n, k) that readings of one place, reached in one way, share."""
        return np.round(table.q / SAME_RAD).astype(np.int64)

    def parts(self, table: T) -> NDArray[np.str_] | None:
        """Return to which part each row (n,) belongs, where parts of a table have set-ups of their own."""
        return None

    def sides(self, table: T) -> Integers | None:
        """Return on which side of its play each joint stands (n, axes): the way of its last move, -1 or 1, 0 where it
        stayed; None where rows do not say from where joints came."""
        return None

    def last_moves(self, table: T) -> Array | None:
        """Return by how much each joint turned (n, axes) rad in its last move; None if rows do not state it."""
        return None

    def counted_back(self, table: T, turns_rad: Array) -> T:
        """Return the table with joints counted back by whole turns (n, axes) rad; only of stands in no order."""
        return table

    def far(self, table: T, arm: Arm) -> Far | None:
        """Return which rows lie far from all others, of places; others are judged beside the calibrated arm alone."""
        return None

    def lost(self, table: T) -> Mask:
        """Return which rows (n,) hold no measurement, by what an instrument writes that has none."""
        return np.zeros(len(table.q), dtype=bool)

    def doubts(self, table: T, model: Model, where: str) -> tuple[str, ...]:
        """Return what a table shows beside the arm alone that a diagnosis should say."""
        return ()

    def angles_of(self, table: T, rig: Rig) -> tuple[Array, Array]:
        """Return polar angle and azimuth (n,) rad under which a map draws each row, nan where it has none."""
        nowhere = np.full(len(table.q), np.nan)
        return nowhere, nowhere


@cache
def kind_named(test: TestName) -> Kind[Table]:
    """Return the kind of a test: what its module in `analysis.procedures` has as KIND, or what a package offers as
    `rig.tests` under its name. Raises FileError for an offer that is none."""
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
    """Return every kind of test, in the order in which they are named everywhere."""
    return map(kind_named, get_args(TestName))

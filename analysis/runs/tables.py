"""Tables of docs/tables.md in memory, the common input of evaluation, simulation and fits, and their columns in files.

Recorded runs are aligned to tables, imported ones are read from files, and simulations produce the same tables. Angles
are in rad, lengths in mm; files contain degrees and mm.

A kind of test is a class, listed here or offered by an installed package as an entry point `rig.tests`. What the layers
above ask of it is in `analysis.procedures.shared.test_kind`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from importlib.metadata import EntryPoint
from itertools import takewhile
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Literal, Self, TypeVar, cast, get_args

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from analysis.robot.kinematics.arm import RAIL_MM, Array, Integers, Mask
from analysis.runs.align import Aligned
from daq.store.chunk import array_of
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.effect import Gauge
from rigs.schema.vocabulary import DRIVEN_AXES, FEWEST_AXES, MOST_AXES, OTHER_TESTS, CircleTest, Direction, TestName

SAME_RAD = 3e-4
"""Largest difference of each joint angle between equal postures, three steps of angles reported by controllers."""


@dataclass(frozen=True)
class Table(ABC):
    """Common part of all tables: the test, and reported joint angles q (n, axes) rad, with a last column for a `rail`,
    in m.
    """

    if TYPE_CHECKING:

        @property
        def test(self) -> TestName: ...
        @property
        def q(self) -> Array: ...

    in_order_of_time: ClassVar[bool] = False
    """True if the rows have increasing times."""
    swept: ClassVar[bool] = False
    """True if joints move during the reading."""
    rail = False

    @property
    @abstractmethod
    def readings(self) -> Array: ...

    def with_readings(self, values: Array) -> Self:
        raise TypeError(f"a {self.test} table has no readings of gauges")

    @property
    def rows(self) -> Integers:
        """Row number (n,) in the file of each reading, or of the first averaged one."""
        row: Integers | None = getattr(self, "row", None)
        return np.arange(1, len(self.q) + 1) if row is None else row

    @property
    def numbers(self) -> Integers:
        """Row in the file, or target, that identifies each row to the user."""
        return self.rows

    @property
    def driven_direction(self) -> Direction | None:
        return None

    @property
    def last_moves(self) -> Array | None:
        return None

    @property
    def sides(self) -> Integers | None:
        """Direction (n, axes) of each joint's last move, -1, 0 or 1: the side of its backlash; None if unknown."""
        return None

    @property
    def lost(self) -> Mask:
        """Mask (n,) of the rows without a measurement, by the value that an instrument then writes."""
        return np.zeros(len(self.q), dtype=bool)

    def thinned(self, count: int) -> Self:
        """Reduce a table of millions of rows to about `count` rows."""
        return self


@dataclass(frozen=True)
class CircleTable(Table):
    """A circle driven in one direction, including lead-in and lead-out: q (n, 6) rad as reported, g_mm (n, 2) of g1 and
    g2.

    u_t_s (n,): individual standard uncertainty of the times, None if unknown.
    """

    in_order_of_time = swept = True
    test: CircleTest
    direction: Direction
    t_s: Array
    q: Array
    g_mm: Array
    u_t_s: Array | None = None

    @property
    def readings(self) -> Array:
        return self.g_mm

    def with_readings(self, values: Array) -> Self:
        return replace(self, g_mm=values)

    @property
    def driven_direction(self) -> Direction:
        return self.direction

    def thinned(self, count: int) -> CircleTable:
        if len(self.q) <= count:
            return self
        rows = slice(None, None, len(self.q) // count)
        return CircleTable(self.test, self.direction, self.t_s[rows], self.q[rows], self.g_mm[rows])


@dataclass(frozen=True)
class TargetTable(Table):
    """Common part of tables of one gauge at the targets of a hemisphere."""

    if TYPE_CHECKING:

        @property
        def target(self) -> Integers: ...
        @property
        def t_s(self) -> Array: ...
        @property
        def g_mm(self) -> Array: ...

    @property
    def readings(self) -> Array:
        return self.g_mm[:, None]

    def with_readings(self, values: Array) -> Self:
        return replace(self, g_mm=values[:, 0])  # type: ignore[call-arg]  # a field of each test at targets

    @property
    def numbers(self) -> Integers:
        return self.target


@dataclass(frozen=True)
class RadialTable(TargetTable):
    """Readings at targets of a hemisphere, in order of time.

    target, orientation (n,): numbers from 1. polar, azimuth (n,) rad. q (n, 6) rad.
    g_mm (n,): |B - TCP| minus the nominal length of the link.
    t_s (n,) s: zeros if the table has no times.
    """

    test: ClassVar[TestName] = "radial"
    target: Integers
    polar: Array
    azimuth: Array
    orientation: Integers
    t_s: Array
    q: Array
    g_mm: Array


@dataclass(frozen=True)
class RepeatabilityTable(TargetTable):
    """Readings at targets approached from outside (`out`), from inside (`in`), or in another way (`none`).

    target, round (n,): numbers from 1. approach (n,) of str. q (n, 6) rad. g_mm (n,). t_s (n,) s as in a radial table.
    """

    test: ClassVar[TestName] = "repeatability"
    target: Integers
    approach: NDArray[np.str_]
    round: Integers
    t_s: Array
    q: Array
    g_mm: Array


@dataclass(frozen=True)
class PlaceTable(Table):
    """Common part of tables of positions, three coordinates per row, each with a posture.

    came_from (n, axes) rad: joint angles before the last move, which determine the side of backlash, or None if they
    are not stated.
    """

    if TYPE_CHECKING:

        @property
        def came_from(self) -> Array | None: ...
        @property
        def xyz_mm(self) -> Array: ...

    @property
    def readings(self) -> Array:
        return self.xyz_mm

    @property
    def last_moves(self) -> Array | None:
        return None if self.came_from is None else self.q - self.came_from

    @property
    def sides(self) -> Integers | None:
        if self.last_moves is None:
            return None
        return np.where(np.abs(self.last_moves) > SAME_RAD, np.sign(self.last_moves), 0).astype(np.int64)

    def counted_back(self, turns_rad: Array) -> Self:
        """Subtract turns_rad (n, axes), multiples of a turn, from the joint angles."""
        came_from = None if self.came_from is None else self.came_from - turns_rad
        return self.with_fields(q=self.q - turns_rad, came_from=came_from)

    def in_content_order(self) -> Self:
        """Sort by `content_order`; each row keeps its number in the file."""
        order = content_order(self)
        columns = {name: values[order] for name, values in vars(self).items() if _is_content(name, values)}
        return self.with_fields(**columns, row=self.rows[order])

    def with_fields(self, **fields: Array | Integers | None) -> Self:
        return replace(self, **fields)


@dataclass(frozen=True)
class PoseTable(PlaceTable):
    """Tool poses measured by a tracker, in the tracker's frame.

    q (n, axes) rad: joint angles; `rail`: with an additional column for the rail position in m.
    xyz_mm (n, 3): positions.
    rpy (n, 3) rad: fixed-axis roll-pitch-yaw angles, None if only positions were measured.
    row (n,): row number in the file of each reading, or of the first averaged reading. None means 1 … n.
    came_from (n, axes) rad: joint angles before the last move, which determine the side of the backlash. None if each
    pose was reached from the previous one.
    """

    test: ClassVar[TestName] = "pose"
    q: Array
    xyz_mm: Array
    rpy: Array | None
    row: Integers | None = None
    rail: bool = False
    came_from: Array | None = None

    @property
    def lost(self) -> Mask:
        """Mask (n,) of the rows at 0, 0, 0, which a tracker writes if it has lost its target."""
        return np.asarray((self.xyz_mm == 0).all(axis=1))


@dataclass(frozen=True)
class TouchTable(PlaceTable):
    """Touches: the ball on the tool is seated in fixed sockets, in successive postures.

    socket (n,) of str. q (n, axes) rad, with a rail as for poses. came_from (n, axes) rad and row (n,) as for poses.
    """

    test: ClassVar[TestName] = "touch"
    socket: NDArray[np.str_]
    q: Array
    came_from: Array | None = None
    row: Integers | None = None
    rail: bool = False

    @property
    def xyz_mm(self) -> Array:
        """Position of the ball relative to its socket: always zero."""
        return np.zeros((len(self.q), 3))


@dataclass(frozen=True)
class PathTable(Table):
    """Tracker recording along paths: times t_s (n,) s and positions xyz_mm (n, 3) in the tracker's frame."""

    in_order_of_time = True
    test: ClassVar[TestName] = "path"
    t_s: Array
    xyz_mm: Array

    @property
    def q(self) -> Array:
        """Empty (n, 0): a tracker reads no joints, and the clocks of tracker and robot differ."""
        return np.empty((len(self.t_s), 0))

    @property
    def readings(self) -> Array:
        return self.xyz_mm


def content_order(table: Table) -> Integers:
    """Row indices (n,) that sort a table by content.

    Sums, random draws and ties then do not depend on the order of the rows.
    """
    columns = [values.reshape(len(values), -1).T for name, values in vars(table).items() if _is_content(name, values)]
    keys = [column for of_field in reversed(columns) for column in of_field[::-1]]
    return np.asarray(np.lexsort(keys), dtype=np.int64)


def _is_content(name: str, values: object) -> bool:
    return name != "row" and isinstance(values, np.ndarray)


GaugeTable = CircleTable | TargetTable
"""Tables of gauge readings with times."""


def joint_columns(axes: int) -> tuple[str, ...]:
    return tuple(f"q{axis}_deg" for axis in range(1, axes + 1))


def second_joint_columns(axes: int) -> tuple[str, ...]:
    """Column names of the joints of a second arm, which holds the socket."""
    return tuple(f"p{axis}_deg" for axis in range(1, axes + 1))


JOINTS = joint_columns(6)
"""Joint columns of the ball link tests."""
COMMANDED = tuple(f"q{axis}_commanded_deg" for axis in range(1, 7))
"""Commanded joint angles, in addition to JOINTS."""
MEASURED = tuple(f"q{axis}_measured_deg" for axis in range(1, 7))
"""Measured joint angles, next to the commanded ones that are used."""
JointSource = Literal["measured", "commanded"]
PLACE = ("x_mm", "y_mm", "z_mm")
TURN = ("rx_deg", "ry_deg", "rz_deg")
CONTROLLER_PLACE = tuple(f"controller_{name}" for name in PLACE)
CONTROLLER_TURN = tuple(f"controller_{name}" for name in TURN)
"""Pose of the tool that the controller computed from the joints, next to the measured one."""
RAIL, RAIL_FROM = "e1_mm", "e1_from_mm"
"""Position of the arm's rail, and its previous position."""
SOCKET = "socket"
"""Column with the socket name of a touch. Any text is permitted."""
WORDS = {"direction": ("acw", "cw"), "approach": ("none", "out", "in")}
"""Columns of text, with the permitted values."""
TIME_U = ("u_t_s", "u_lag_s")
"""Standard uncertainties of the gauges' time relative to the joints' time: individual, and common to all rows."""
COUNTS = ("target", "orientation", "round")
"""Columns of positive integers. All other known columns contain real numbers."""


@dataclass(frozen=True)
class Layout:
    """Required and optional columns of a table. Other columns are preserved.

    Each group of columns in `together` must be complete or absent.
    """

    required: tuple[str, ...]
    optional: tuple[str, ...] = ()
    together: tuple[tuple[str, ...], ...] = ()

    @property
    def known_columns(self) -> tuple[str, ...]:
        return (*self.required, *self.optional)


def came_from_columns(axes: int) -> tuple[str, ...]:
    return tuple(f"q{axis}_from_deg" for axis in range(1, axes + 1))


@dataclass(frozen=True)
class Rows:
    """Columns of docs/tables.md for a kind of test, without extra columns."""

    columns: pa.Table

    @cached_property
    def axes(self) -> int:
        """Number of joints, at least six. Unrelated columns with a joint name, such as a gripper, contain text."""
        joints = list(takewhile(self._is_measured, joint_columns(MOST_AXES)))
        return len(joints) if len(joints) >= FEWEST_AXES else DRIVEN_AXES

    @cached_property
    def rail(self) -> bool:
        """True if the table contains rail positions; an unrelated column of that name contains text."""
        return self._is_measured(RAIL)

    def has(self, names: tuple[str, ...]) -> bool:
        return set(names) <= set(self.columns.column_names)

    def values(self, names: tuple[str, ...]) -> Any:
        """Columns (n,) or (n, k) in memory: angles in rad, the position of a rail in m, counts and words."""
        columns = [self._value(name) for name in names]
        return columns[0] if len(columns) == 1 else np.stack(columns, axis=1)

    def _value(self, name: str) -> Any:
        column = self.columns[name]
        if name in (*WORDS, SOCKET):
            return np.array(column.to_pylist(), dtype=np.str_)
        values = array_of(column)
        if name in COUNTS:
            return values
        floats = np.asarray(values, dtype=float)
        return (
            np.radians(floats) if name.endswith("_deg") else floats / RAIL_MM if name in (RAIL, RAIL_FROM) else floats
        )

    def _is_measured(self, name: str) -> bool:
        schema = self.columns.schema
        return name in schema.names and pa.types.is_floating(schema.field(name).type)


def _cells(name: str, values: NDArray[Any]) -> NDArray[Any] | list[str]:
    """A column of a file: the inverse of `Rows.values`."""
    if values.dtype.kind == "U":
        words: list[str] = values.tolist()
        return words
    return np.degrees(values) if name.endswith("_deg") else RAIL_MM * values if name in (RAIL, RAIL_FROM) else values


_COLUMNS = {"xyz_mm": PLACE, "rpy": TURN, "polar": ("polar_deg",), "azimuth": ("azimuth_deg",)}
"""Columns of fields that have other names in files."""
T = TypeVar("T", bound=Table)
_OWN: dict[TestName, str] = {
    "yaw": "circle:Yaw",
    "roll": "circle:Roll",
    "radial": "radial:Radial",
    "repeatability": "repeatability:Repeatability",
    "pose": "pose:Pose",
    "touch": "touch:Touch",
    "path": "path:Path",
}
"""Classes of rig's own tests in `analysis.procedures`, imported when a table of the test is first read."""
TESTS: tuple[TestName, ...] = get_args(TestName)
"""All tests, in the order in which they are listed everywhere."""


class TableFormat(ABC, Generic[T]):
    """Columns of a test's table, and its readings in a recorded run."""

    test: ClassVar[TestName]
    gauges: ClassVar[tuple[Gauge, ...]] = ()
    """Gauges used by the test."""
    certified: ClassVar[tuple[str, ...]] = ()
    """Parts of the rig file that may have a certificate and determine the readings: gauges, ball, link."""
    table: ClassVar[type[Any]]
    """Class of its tables."""
    fields: ClassVar[tuple[str, ...]]
    """Fields of a table that a file must contain, in the order of the columns."""
    optional: ClassVar[tuple[str, ...]] = ()
    """Fields that a file may lack. The table then has zeros as times, and None as other fields."""
    further: ClassVar[tuple[tuple[str, ...], ...]] = ()
    """Known columns that are no field, in groups that are complete or absent."""

    def layout(self, axes: int = DRIVEN_AXES, *, rail: bool = False) -> Layout:
        axes = DRIVEN_AXES if self.gauges else axes  # an arm of six axes drives the link
        required, optional = (
            [name for field in fields for name in self._columns(field, axes, rail)]
            for fields in (self.fields, self.optional)
        )
        groups = *(self._columns(field, axes) for field in self.optional), *self.further
        further = (name for group in self.further for name in group)
        return Layout(tuple(required), (*optional, *further), tuple(group for group in groups if len(group) > 1))

    def table_of(self, rows: Rows, direction: Direction | None, where: str) -> T:
        fields = {field: self.read_field(field, rows) for field in (*self.fields, *self.optional)}
        rail = {"rail": rows.rail} if issubclass(self.table, PlaceTable) else {}
        return cast("T", self.table(**fields, **rail))

    def read_field(self, field: str, rows: Rows) -> Any:
        """Values of a field. A rail was at its present position if the previous one is not stated."""
        names = self._columns(field, rows.axes, rows.rail)
        names = tuple(RAIL if name == RAIL_FROM and not rows.has((name,)) else name for name in names)
        if rows.has(names):
            return rows.values(names)
        return np.zeros(rows.columns.num_rows) if field == "t_s" else None

    def columns(self, table: T) -> Mapping[str, Array | Integers | Sequence[str] | pa.Array]:
        """Columns (n,) of docs/tables.md in the documented order, in degrees and mm."""
        cells: dict[str, Any] = {}
        for field in (*self.fields, *self.optional):
            values = getattr(table, field)
            if isinstance(values, str):
                values = np.full(len(table.q), values)
            if values is None or (field in self.optional and field == "t_s" and not values.any()):
                continue
            names = self._columns(field, table.q.shape[1] - table.rail, table.rail)
            columns = values.T if values.ndim > 1 else [values]
            cells |= {name: _cells(name, column) for name, column in zip(names, columns, strict=False)}
        return cells

    def _columns(self, field: str, axes: int, rail: bool = False) -> tuple[str, ...]:
        on_rail = rail and issubclass(self.table, PlaceTable)
        match field:
            case "q":
                return (*joint_columns(axes), *[RAIL] * on_rail)
            case "came_from":
                return (*came_from_columns(axes), *[RAIL_FROM] * on_rail)
            case "g_mm":
                return tuple(f"{gauge}_mm" for gauge in self.gauges)
        return _COLUMNS.get(field, (field,))

    def recorded(self, data: Aligned, rig: Rig, direction: Direction | None, where: str) -> tuple[T, list[str]]:
        """Table of a recorded run, and doubts as text. Raises FileError."""
        problem = f"a recorded {self.test} run has no measuring instrument"
        raise FileError(where, problem, "import the table with rig import", code="readings.unsuitable")

    def stands(self, table: T) -> Mask | None:
        """Mask (n,) of the rows that start a standstill of the robot.

        None if each row is a separate visit, or the robot kept moving.
        """
        return None

    def averaged(self, table: T, first: Mask, mean: Callable[[Array], Array]) -> T:
        """Average the values over each standstill by `mean`; first (n,): its first row, which supplies the labels."""
        columns = {name: column for name, column in vars(table).items() if isinstance(column, np.ndarray)}
        return replace(table, **{name: mean(c) if c.dtype.kind == "f" else c[first] for name, c in columns.items()})


@cache
def format_of(test: TestName) -> TableFormat[Table]:
    """The kind of a test. Raises FileError if the package that offers it is unusable."""
    own = EntryPoint(test, f"analysis.procedures.{_OWN[test]}", "rig.tests") if test in _OWN else None
    offer = own or OTHER_TESTS[test]
    try:
        kind: TableFormat[Table] = offer.load()()
        if kind.test == test:
            return kind
        reason = f"it is the class of {kind.test!r}"
    except Exception as error:  # noqa: BLE001 - whatever a foreign module raises as it is imported
        reason = str(error)
    problem = f"{offer.value}, which a package offers, cannot be used: {reason}"
    remedy = "offer a class of test kinds, as docs/how-to/add-a-test-kind.md shows, or uninstall that package"
    raise FileError(f"test {test}", problem, remedy, code="package.missing")


def table_from(columns: pa.Table, test: TestName, direction: Direction | None, where: str) -> Table:
    """Table from columns of docs/tables.md, ignoring additional ones.

    Raises FileError for columns of a different test, an empty table, and any content that import rejects.
    """
    rows, table_format = Rows(columns), format_of(test)
    missing = [name for name in table_format.layout(rows.axes).required if name not in columns.column_names]
    if missing or not columns.num_rows:
        problem = f"the table has no {', '.join(missing) or 'rows'}"
        raise FileError(where, problem, "import the table again", code="table.invalid")
    table = table_format.table_of(rows, direction, where)
    check_table_rows(table, where)
    return table


def u_lag_s_of(columns: pa.Table) -> float:
    """Common standard uncertainty in s of the gauges' time relative to the joints', 0 if not stated."""
    stated = "u_lag_s" in columns.column_names and pa.types.is_floating(columns.schema.field("u_lag_s").type)
    return float(Rows(columns).values(("u_lag_s",)).max(initial=0.0)) if stated else 0.0


def columns_of(table: Table) -> pa.Table:
    """Columns of docs/tables.md in their order, in degrees and mm. Times that are all zero are omitted."""
    return pa.table({name: pa.array(values) for name, values in format_of(table.test).columns(table).items()})


# Rules for all tables from any program: finite, plausible numbers and increasing times.
#
# Import reports violations with line numbers. Run directories must be checked too, because their files may have been
# edited or written by another program. In one run, a time of nan or 1e300 stopped the analysis of all runs.

LARGEST = 1e12
"""Largest plausible angle, length or time, in any unit that may have been chosen by mistake."""
_REMEDY = "restore the run from a copy, or correct and re-import the table"


def check_table_rows(table: Table, where: str) -> None:
    """Raise FileError for the first row that import would reject."""
    columns = {name: values for name, values in vars(table).items() if isinstance(values, np.ndarray)}
    for field, values in columns.items():
        name = "g1_mm" if field == "g_mm" and values.ndim == 1 else field
        rows = values.reshape(len(values), -1)
        if values.dtype.kind == "f":
            _check_rows(np.abs(rows) <= LARGEST, name, rows, "which is not a plausible measured value", where)
            if name.startswith("u_"):
                _check_rows(rows >= 0, name, rows, "below zero", where)
        elif values.dtype.kind == "i":
            _check_rows(rows >= 1, name, rows, "but counting starts at 1", where)
    if table.in_order_of_time:
        t_s = columns["t_s"]
        back = np.flatnonzero(np.diff(t_s) <= 0)
        if len(back):
            row = int(back[0]) + 1
            problem = f"row {row + 1}: time does not increase, {t_s[row]:g} s after {t_s[row - 1]:g} s"
            raise FileError(where, problem, _REMEDY, code="table.invalid")


def _check_rows(is_good: Mask, name: str, rows: Array, why: str, where: str) -> None:
    good = is_good.all(axis=1)
    if not good.all():
        row = int(np.argmin(good))
        values = ", ".join(f"{value:g}" for value in rows[row])
        raise FileError(where, f"row {row + 1} has {name} = {values}, {why}", _REMEDY, code="table.invalid")

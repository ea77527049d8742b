"""What rig asks of a kind of test: figures, prediction by the model of an arm, checks of its labels, rows for a fit.

A kind is a class of one module (`touch.py` is the shortest), registered by name in `analysis.runs.tables`. The
usual answers are here, so a kind states only what differs. A check returns findings: data that contradict a label.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Protocol, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from analysis.robot.kinematics.arm import Arm, Array, Integers, Mask
from analysis.robot.kinematics.joint_limits import impossible_rad
from analysis.robot.predict import Model, ModelScene, Path, SetUp, moved
from analysis.runs.noise.spectrum import LapNoise
from analysis.runs.tables import SAME_RAD, Table, TableFormat, format_of
from analysis.runs.tabular import for_json
from rigs.effects import Effect
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.vocabulary import Direction, TestName
from rigs.text import listed

if TYPE_CHECKING:
    from analysis.procedures.shared.quantity import Quantity
    from analysis.procedures.shared.result_curves import ResultCurve


@dataclass(frozen=True)
class Facts:
    """Properties of a test's readings and of its set-up."""

    of_places: bool = False
    """A reading is a position, three coordinates of a target or ball on the tool."""
    of_tracker: bool = False
    """An instrument measures the positions. It may have any place, and may read joints before they rest."""
    constants_apart: bool = False
    """The readings alone determine the constants of an arm, which then have separate prior widths."""
    setup_terms: int = 4
    frame_terms: int = 0
    """Leading set-up terms of the instrument or socket. The others belong to the target on the tool, common to all
    placements.
    """
    wild_spreads: float = 10.0
    """Robust standard deviations from which a reading is an outlier relative to a calibrated arm. The standard
    deviation is at least the largest of real cells, 0.06 mm. Chosen: as for the sphere of a radial test.
    """
    assumed_sd_mm: float = math.nan
    """Standard deviation of a coordinate if no position was visited twice."""


@dataclass(frozen=True)
class Labels:
    """Words of a test for screen and page."""

    example: tuple[str, float, float] | None = None
    """Figure with bounds for warning and failure, of the size of the values in docs/rig-file.md, to be replaced."""
    part: str = ""
    """Section of `tests` in a rig file describing place and motion of the test."""
    further: tuple[str, str] | None = None
    """Name in a plan as an additional test in a rig file with that section, and the reason for adding it."""
    along: str = "place"
    """Abscissa of the curve in a table of measured and simulated values."""
    setup: str = "the ball's position and the gauges' zeros"
    no_repeats: str = ""
    """Message if no reading was repeated; empty if it is that of all tests."""
    no_scale: str = ""
    """Message if no distance is known; empty if the readings are lengths."""
    joints_fit: str = "rows match the path of the test"
    """Predicate of a message about rows whose joints have the labelled meaning."""
    rows: str = "targets"
    distance_from: str = ""
    """Origin of the distance of an outlier."""
    outlier_check: str = ""
    """What to check for an outlier."""
    unsupported_reason: str = ""
    """Reason why the test reveals nothing about single joints; empty if it does."""


def facts_of(test: TestName) -> Facts:
    """Raises FileError if the package that offers the test is unusable."""
    kind: Any = format_of(test)
    facts: Facts = kind.facts
    return facts


def labels_of(test: TestName) -> Labels:
    """Raises FileError if the package that offers the test is unusable."""
    kind: Any = format_of(test)
    labels: Labels = kind.labels
    return labels


def shows_joints(test: TestName) -> bool:
    """True if a test reveals single joints of an arm, as a diagnosis requires."""
    return not labels_of(test).unsupported_reason


def no_joints_error(test: TestName, where: str) -> FileError:
    return FileError(
        where, labels_of(test).unsupported_reason, "give poses, touches or circles", code="readings.unsuitable"
    )


T = TypeVar("T", bound=Table)


class Evaluated(Protocol):
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
    """What is known of the instruments of a run besides its table."""

    u_lag_s: float = 0.0
    """Standard uncertainty of the gauges' time relative to the joints'."""
    u_gauge_mm: float | None = None
    """Standard uncertainty of one reading; None for that of the rig file."""
    like: tuple[LapNoise, LapNoise] | None = None
    """Noise of angle and distance in a different run, for a circle of a single lap."""

    def u_mm(self, rig: Rig) -> float:
        return rig.gauges.g1.accuracy_mm if self.u_gauge_mm is None else self.u_gauge_mm


@dataclass(frozen=True)
class Noise:
    """Standard deviations of a simulation. White gauge noise comes from the rig file."""

    wander_mm: float = 0.001
    wander_s: float = 0.5
    scatter_deg: float = 0.0002
    scatter_mm: float = 0.001


@dataclass(frozen=True)
class Simulation:
    """Options of a simulated run. seed: None for no noise. effects: in place of those of the rig file. noise: in
    addition to that of the gauges."""

    seed: int | None
    effects: Sequence[Effect] | None = None
    noise: Noise | None = None


@dataclass(frozen=True)
class Meaning:
    """A different meaning of the joint columns: q (n, axes) as labelled becomes q M' + c.

    mistakes: number of independent mistakes that it assumes.
    """

    columns: tuple[str, ...]
    words: str
    remedy: str
    matrix: Array
    offset: Array
    mistakes: int = 1

    def of(self, q: Array) -> Array:
        """Convert labelled angles to the true ones. Further columns, such as a rail, are kept."""
        axes = len(self.offset)
        return np.column_stack([q[:, :axes] @ self.matrix.T + self.offset, q[:, axes:]])


@dataclass(frozen=True)
class JudgedMeaning:
    """A meaning with its residual: rms in mm of `values` redundant readings."""

    meaning: Meaning
    left_mm: float
    values: int


Verdict = tuple[JudgedMeaning | None, float, list[JudgedMeaning]]
"""Result of comparing meanings: the meaning that fits although the labelled one does not, or None; the residual of
the labelled meaning, rms mm; and all meanings that fit as well as the best.
"""


@dataclass(frozen=True)
class PathDeviation:
    """Median distance of tool poses from the path of a test, in mm and as a share of the path size.

    on: True if it is acceptable and the tool has the prescribed orientation.
    """

    off_mm: float
    off: float
    on: bool


Finders = Mapping[str, Callable[[Any, Rig], "Iterable[Finding]"]]
"""Functions that find violations of conventions that only few tests have, by the name of the convention."""


class TestKind(TableFormat[T]):
    """A kind of test. Methods raise FileError for a table that is no valid measurement."""

    facts: ClassVar[Facts] = Facts()
    labels: ClassVar[Labels] = Labels()
    finders: ClassVar[Finders] = {}

    @abstractmethod
    def evaluate(self, table: T, rig: Rig, where: str, instruments: Instruments) -> Evaluated: ...

    def require_evaluable(self, table: T, rig: Rig, where: str) -> None:
        """Raise FileError if an evaluation will refuse the table for an immediately visible reason, gauges excluded."""

    def simulated(self, rig: Rig, direction: Direction | None, run: Simulation) -> T:
        """A run as it would be measured. Raises FileError if the robot cannot do the test."""
        raise FileError(
            f"{self.test} test", "is not simulated", "simulate a different test", code="readings.unsuitable"
        )

    def setup(self, rig: Rig) -> SetUp:
        raise no_joints_error(self.test, f"a {self.test} table")

    def path(self, model: Model, table: T) -> Path:
        raise no_joints_error(self.test, f"a {self.test} table")

    def read(self, model: Model, table: T, path: Path, scene: ModelScene, setup: SetUp) -> Array:
        """Expected readings (m, k): gauges in mm; for places T_instrument_target, (m, 16) row by row."""
        raise no_joints_error(self.test, f"a {self.test} table")

    def unit_findings(self, table: T, rig: Rig, T_tool: Array) -> Iterable[Finding]:
        return ()

    def cannot_tell(self, table: T, rig: Rig) -> str:
        """Reason why a table cannot reveal the meaning of the joint columns; empty if it can."""
        return self.labels.unsupported_reason

    def judged_joints(self, table: T, rig: Rig) -> Verdict:
        raise no_joints_error(self.test, f"rig {rig.name}")

    def off_path(self, table: T, rig: Rig, T_tool: Array) -> PathDeviation | None:
        """Deviation of tool poses T_tool (n, 4, 4) from the nominal path; None if the rig file does not state it."""
        return None

    def targets(self, table: T, rig: Rig) -> Array | None:
        """Target positions (n, 3) mm of the rows; None if the rig file does not contain them."""
        return None

    def rows_used(self, table: T, rig: Rig, where: str) -> Integers:
        """Numbers (m,) of the rows with explained readings. Raises FileError for a table of another rig."""
        return np.arange(len(table.q))

    def visits(self, table: T) -> Integers:
        """Numbers (n, k) shared by readings of the same place, reached in the same way; usually of one posture."""
        return np.round(table.q / SAME_RAD).astype(np.int64)

    def parts(self, table: T) -> NDArray[np.str_] | None:
        return None

    def outliers(self, table: T, arm: Arm) -> Outliers | None:
        """Rows far from all others, for places; other tests are compared with the calibrated arm only."""
        return None

    def doubts(self, table: T, model: Model, where: str) -> tuple[str, ...]:
        """Doubts raised by a table compared with the arm alone, for the diagnosis to report."""
        return ()

    def angles_of(self, table: T, rig: Rig) -> tuple[Array, Array]:
        """Polar angle and azimuth (n,) rad of each row on a map, nan if there is none."""
        nowhere = np.full(len(table.q), np.nan)
        return nowhere, nowhere


def kind_of(test: TestName) -> TestKind[Table]:
    return cast("TestKind[Table]", format_of(test))


def findings_against(convention: str, table: Table, rig: Rig) -> Iterable[Finding]:
    find = kind_of(table.test).finders.get(convention)
    return find(table, rig) if find else ()


def evaluate(
    table: Table,
    rig: Rig,
    u_lag_s: float,
    where: str,
    u_gauge_mm: float | None = None,
    like: tuple[LapNoise, LapNoise] | None = None,
) -> Evaluated:
    return kind_of(table.test).evaluate(table, rig, where, Instruments(u_lag_s, u_gauge_mm, like))


def nominal_setup(rig: Rig, table: Table) -> SetUp:
    return kind_of(table.test).setup(rig)


def path_of(model: Model, table: Table) -> Path:
    return kind_of(table.test).path(model, table)


def predict(model: Model, table: Table, path: Path, setup: SetUp) -> Array:
    """Readings (m, k) of a table: gauges in mm; for poses T_instrument_target, (m, 16) row by row."""
    return read(model, table, path, moved(model, path), setup)


def read(model: Model, table: Table, path: Path, scene: ModelScene, setup: SetUp) -> Array:
    """Like `predict`, from an existing scene, because a set-up does not change the tool."""
    return kind_of(table.test).read(model, table, path, scene, setup)


def check_joints(where: str, q: Array, remedy: str) -> None:
    """Raise FileError if the joints never moved, or have a different unit."""
    if np.ptp(q, axis=0).max() < 1e-6:
        raise FileError(where, "the robot stood still in all rows", remedy, code="readings.unsuitable")
    if most := impossible_rad(q):
        problem = f"a joint at {np.degrees(most):.0f}° is impossible"
        raise FileError(where, problem, "check the unit of q: files hold degrees", code="table.unclear")


def check_numbers(where: str, **columns: Array) -> None:
    for name, values in columns.items():
        if np.isfinite(values).all():
            continue
        bad = np.asarray(~np.isfinite(values.reshape(len(values), -1)).all(axis=1))
        if bad.all():
            problem = f"{name} contains no valid number in any of the {len(bad)} rows"
            remedy = "check that the instrument measures and sends, and repeat the measurement"
            raise FileError(where, problem, remedy, code="table.invalid")
        row = int(np.argmax(bad)) + 1
        problem = f"{name} of row {row} is not a number ({bad.sum()} such rows)"
        raise FileError(where, problem, "remove such rows", code="table.invalid")


def require_live_gauges(where: str, **readings: Array) -> None:
    """Raise FileError if a gauge has constant readings: real gauges never do."""
    for name, values in readings.items():
        if len(values) > 1 and np.ptp(values) == 0:
            remedy = "check that the gauge touches and sends (a simulation needs noise), and repeat the measurement"
            problem = f"{name} reads {values[0]:g} mm in all {len(values)} rows"
            raise FileError(where, problem, remedy, code="readings.unsuitable")


def check_radius(where: str, radius_mm: float) -> None:
    if not (np.isfinite(radius_mm) and radius_mm > 0):
        problem = f"a radius of {radius_mm:g} mm is impossible"
        raise FileError(where, problem, "correct radius_mm in the rig file", code="rig_file.invalid")


Strength = Literal["impossible", "decisive", "likely"]
"""Certainty of a finding.

impossible: no robot produces such data with this label; import refuses them. decisive: the labelled meaning does not
fit; figures are reported with a doubt, and no fault is derived from them. likely: a doubt.
"""


@dataclass(frozen=True)
class Misfit:
    """Residuals of the readings, rms in mm, with the labelled and with the alternative meaning, and the difference
    of the log-likelihoods in nats.
    """

    as_labelled_mm: float
    as_meant_mm: float
    log_likelihood: float


@dataclass(frozen=True)
class Finding:
    """Evidence that the data have a different meaning from the labelled one.

    runs: names of the affected runs. columns: affected columns of the table. meant: probable content of these columns.
    what: observation as text. remedy: action. misfit: residuals; None if the observation is a count or a label.
    """

    convention: str
    strength: Strength
    columns: tuple[str, ...]
    meant: str
    what: str
    remedy: str
    misfit: Misfit | None = None
    runs: tuple[str, ...] = ()

    @property
    def words(self) -> str:
        return f"{self.what}; {self.remedy}"

    def to_dict(self) -> dict[str, Any]:
        plain: dict[str, Any] = for_json(
            {
                "convention": self.convention,
                "strength": self.strength,
                "runs": list(self.runs),
                "columns": list(self.columns),
                "meant": self.meant,
                "what": self.what,
                "remedy": self.remedy,
                "misfit": None if self.misfit is None else dict(vars(self.misfit)),
            }
        )
        return plain


MOST_LISTED_ROWS = 40
"""Largest number of outliers that a message lists."""


@dataclass(frozen=True)
class Outliers:
    """Poses (n,) far from the arm, with their distances in mm, excluded if they are accidents of the instrument."""

    far: Mask
    far_mm: Array
    by_accident: bool

    @property
    def wild(self) -> Mask:
        return self.far if self.by_accident else np.zeros_like(self.far)

    def words(self, table: Table) -> str:
        if self.by_accident or not self.far.any():
            return ""
        labels, rows = labels_of(table.test), listed(table.rows[self.far].tolist(), MOST_LISTED_ROWS)
        far = length_in_words(self.far_mm[self.far].max())
        fact = f"{self.far.sum()} of {len(self.far)} {labels.rows} are up to {far} {labels.distance_from}"
        return (
            f"{fact} (rows {rows}). They were kept, because so "
            "many, or all in one range of a joint, are not outliers; check that the robot was at rest, that instrument "
            "and base did not move, and the signs, order and zeros of the joints"
        )


def length_in_words(mm: float) -> str:
    return f"{mm / 1000:.2g} m" if mm >= 1000 else f"{mm:.3g} mm"

"""From runs to their results, for every report, plot and script; and whether a recorded run is a measurement, asked
while the robot can still drive it again.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any
from weakref import WeakValueDictionary

import numpy as np
import pyarrow as pa

from analysis.procedures.checks.check_runs import doubts_of, why_no_measurement
from analysis.procedures.circle.evaluate import CircleResult
from analysis.procedures.circle.long_circle import long_circle
from analysis.procedures.shared.certificate_uncertainty import with_certificates
from analysis.procedures.shared.evaluate import Evaluated, evaluate
from analysis.procedures.shared.quantity import Quantity
from analysis.procedures.shared.reduction import Reduced
from analysis.procedures.shared.result_curves import JointReversal, ResultCurve, reversals_of_rig
from analysis.runs.align import robot_alone
from analysis.runs.batch.fetched import fetched
from analysis.runs.loading import Measured, load_measured, measured_in, measured_of
from analysis.runs.noise.spectrum import LapNoise
from analysis.runs.tables import CircleTable
from analysis.runs.tabular import Tabular, for_json, table_of_rows
from daq.store import read_run
from rigs.errors import DirectionError, FileError
from rigs.schema.vocabulary import WITHOUT_GAUGES, Direction


@dataclass(frozen=True)
class Result(Tabular):
    """An evaluated run. measured: the run as it was read; found: what its test found, in radians and mm; figures: every
    figure by the name of docs/figures.md, which ends in its unit."""

    measured: Measured
    found: Evaluated
    figures: dict[str, Quantity]

    @cached_property
    def curve(self) -> ResultCurve:
        """The curve or the points behind the figures, in degrees and mm."""
        return self.found.as_curve

    @cached_property
    def reversals(self) -> tuple[JointReversal, ...]:
        """Where the joints turn back on the nominal circle, by circle angle; none for the other tests.

        Raises FileError where the robot of the rig file cannot drive its circle.
        """
        return reversals_of_rig(self.measured.rig) if isinstance(self.found, CircleResult) else ()

    @property
    def title(self) -> str:
        """Test and direction, as `yaw acw`."""
        return self.measured.title

    @property
    def name(self) -> str:
        """What the run is called."""
        return self.measured.run.manifest.name

    @property
    def test(self) -> str:
        """Which test it is."""
        return self.measured.run.manifest.test

    @cached_property
    def doubts(self) -> tuple[str, ...]:
        """What a person should know before trusting the figures, in words."""
        return (*doubts_of(self.measured), *self.found.notes)

    @property
    def without_rows(self) -> Result:
        """The same figures and doubts, of a circle without the rows that they are of: what many runs are kept as. The
        run's digest is that of its readings all the same."""
        measured, table = self.measured, self.measured.table
        if not isinstance(self.found, CircleResult) or not isinstance(table, CircleTable):
            return self
        run = replace(measured.run, table=None)
        vars(run)["readings_sha256"] = measured.run.readings_sha256
        none = replace(table, t_s=table.t_s[:0].copy(), q=table.q[:0].copy(), g_mm=table.g_mm[:0].copy(), u_t_s=None)
        bare = replace(measured, run=run, table=none)
        result = replace(self, measured=bare, found=self.found.without_rows)
        vars(result)["doubts"] = self.doubts
        return result

    @property
    def lap_noise(self) -> tuple[LapNoise, LapNoise] | None:
        """Noise of angle and distance between the laps, which a run of one lap can borrow; None where there are not
        two laps."""
        if not isinstance(self.found, CircleResult) or self.found.laps.count < 2:
            return None
        return self.found.curve.noise, self.found.distance.curve.noise

    def to_table(self) -> pa.Table:
        """The figures, a row each: figure, value, u (standard uncertainty), unit, samples, noise."""
        rows = [{"figure": name, **asdict(figure)} for name, figure in self.figures.items()]
        return table_of_rows(("figure", "value", "u", "unit", "samples", "noise"), rows)

    def to_dict(self) -> dict[str, Any]:
        """Run, figures and doubts in plain types, None for what is not known: a run of `rig analyse --json`."""
        manifest = self.measured.run.manifest
        warmth = self.measured.condition.warmth or {}
        plain: dict[str, Any] = for_json(
            {
                "run": str(self.measured.path),
                "name": manifest.name,
                "rig": self.measured.rig.name,
                "test": manifest.test,
                "direction": manifest.direction,
                "started": manifest.started,
                "samples": self.found.samples,
                "u_lag_s": self.measured.u_lag_s,
                "figures": {name: asdict(figure) for name, figure in self.figures.items()},
                "doubts": list(self.doubts),
                **({"axes": [asdict(axis) for axis in axes]} if (axes := getattr(self.found, "axes", ())) else {}),
                **({"warmth": {str(axis): asdict(warm) for axis, warm in warmth.items()}} if warmth else {}),
            }
        )
        return plain


@dataclass(frozen=True)
class Borrower:
    """A run of a single lap at a place among results, and the noise of angle and distance that it can borrow."""

    place: int
    measured: Measured
    noise: tuple[LapNoise, LapNoise]

    def __str__(self) -> str:
        return str(self.measured.path)


def evaluate_runs(runs: Sequence[Measured]) -> list[Result]:
    """Evaluate runs that were read; one of a single lap borrows the noise of another run of its test. Raises
    FileError."""
    results = [result_of(run) for run in runs]
    for borrower in borrowers(results):
        results[borrower.place] = evaluated_again(borrower)[1]
    return results


def read_and_evaluated(path: Path) -> Result:
    """The result of a run directory by itself. Raises FileError."""
    return result_of(load_measured(path))


def figures_alone(path: Path) -> Result:
    """The result of a run directory without its rows, which many runs are kept as. Raises FileError."""
    return _alone(path, None)


def figures_again(borrower: Borrower) -> tuple[int, Result]:
    """The place of a run that is read again, and its result, without its rows, with the noise of another. Raises
    FileError."""
    return borrower.place, _alone(borrower.measured.path, borrower.noise)


def _alone(path: Path, like: tuple[LapNoise, LapNoise] | None) -> Result:
    """The result of a run directory without its rows, of a long circle from its parts."""
    with fetched(path) as directory:
        in_parts = long_circle(directory, path)
        measured, reduced = in_parts or (measured_in(directory, path), None)
    return _evaluated(measured, like, reduced).without_rows


def evaluated_again(borrower: Borrower) -> tuple[int, Result]:
    """The place of a run, and its result with the noise of another. Raises FileError."""
    return borrower.place, result_of(borrower.measured, borrower.noise)


def borrowers(results: Sequence[Result]) -> list[Borrower]:
    """The runs of a single lap with the noise of the first of their test that has more, where there is one."""
    places = {id(result): place for place, result in enumerate(results)}
    runs: list[Borrower] = []
    for group in by_test(results):
        noise = next((result.lap_noise for result in group if result.lap_noise), None)
        single = (run for run in group if isinstance(run.found, CircleResult) and run.found.laps.count == 1)
        runs += [Borrower(places[id(run)], run.measured, noise) for run in single if noise]
    return sorted(runs, key=lambda borrower: borrower.place)


def result_of(measured: Measured, like: tuple[LapNoise, LapNoise] | None = None) -> Result:
    """Evaluate a run that has been read; like: noise of angle and distance in another run, for one of a single lap.

    A run is evaluated once as long as somebody holds its result: a report and the diagnosis in it ask for the same.
    Raises FileError.
    """
    kept = _KEPT.get(id(measured))
    if kept is not None and kept.measured is measured and like is None:
        return kept
    result = _evaluated(measured, like)
    if like is None:
        _KEPT[id(measured)] = result
    return result


_KEPT: WeakValueDictionary[int, Result] = WeakValueDictionary()
"""The results that somebody holds, by the identity of their run, which each of them holds."""


def _evaluated(measured: Measured, like: tuple[LapNoise, LapNoise] | None, reduced: Reduced | None = None) -> Result:
    """Evaluate a run; reduced: the readings of all rows, where its table has but some of them. Raises FileError."""
    where = str(measured.path)
    evaluated = evaluate(measured.table, measured.rig, measured.u_lag_s, where, like=like, reduced=reduced)
    figures = dict(evaluated.figures)
    if isinstance(evaluated, CircleResult):
        # The angle and the distance both show where the ball is; robot errors make them differ.
        distance = evaluated.distance.figures
        figures |= {f"distance_{name}" if name in figures else name: figure for name, figure in distance.items()}
    figures = with_certificates(figures, measured.systematic, measured.rig, measured.run.manifest.test)
    friction = measured.condition.friction or {}
    figures |= {f"friction_j{axis}_a": Quantity(joint.current_a, joint.u_a, "a") for axis, joint in friction.items()}
    return Result(measured, evaluated, figures)


def by_test(results: Sequence[Result]) -> list[list[Result]]:
    """Results in groups of one test of one robot at one place, in the order in which they first come."""
    groups: list[list[Result]] = []
    for result in results:
        for group in groups:
            if _same_cell(group[0], result):
                group.append(result)
                break
        else:
            groups.append([result])
    return groups


def _same_cell(first: Result, second: Result) -> bool:
    rig, its = first.measured.rig, second.measured.rig
    # What is quick to compare comes first: a year of a plant has a thousand runs and more.
    if first.test != second.test or rig.name != its.name:
        return False
    if first.measured.run.manifest.placement != second.measured.run.manifest.placement:
        return False
    kind = first.measured.table.kind  # without gauges there is no place that a rig file knows
    same_place = not (kind.gauges and kind.part) or getattr(rig.tests, kind.part) == getattr(its.tests, kind.part)
    return same_place and rig.robot == its.robot


_END_S, _MOVES_RAD = 0.5, float(np.radians(0.05))
"""A robot drives at the end of a run where a joint turns by so much in so long: five times what a stand shows."""


@dataclass(frozen=True)
class Fitness:
    """What is to be said of a run that has just ended: `why` `rig analyse` would refuse it, empty where it would not;
    the direction that the robot `drove`, where another label mends it; whether it was `still_driving` at the end."""

    why: str
    drove: Direction | None
    still_driving: bool


def fitness(run: Path) -> Fitness:
    """Return whether a run can be used, and what would mend it."""
    why, drove, still_driving = "", None, False
    try:
        recorded = read_run(run)
        with suppress(FileError):
            t_s, q, _ = robot_alone(run, recorded)
            still_driving = bool(np.ptp(q[t_s >= t_s[-1] - _END_S], axis=0).max() > _MOVES_RAD)
        if recorded.manifest.test not in WITHOUT_GAUGES:  # which has a table of its own
            measured = measured_of(recorded)
            why = why_no_measurement(measured)
            if not why:
                result_of(measured)
    except DirectionError as error:
        why, drove = error.what, error.drove
    except FileError as error:
        why = error.what
    return Fitness(why, drove, still_driving)


def why_unusable(run: Path) -> str:
    """Return why `rig analyse` would refuse a run, or a convention shows that it is none; empty where it is good."""
    return fitness(run).why

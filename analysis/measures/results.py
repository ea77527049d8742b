"""From run directories to their results, for every report, plot and script."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from analysis.measures.certificate_uncertainty import with_certificates
from analysis.measures.evaluate import Evaluated, evaluate
from analysis.measures.link_angle import CircleResult
from analysis.measures.quantity import Quantity
from analysis.measures.rig_agreement import doubts_of
from analysis.noise.spectrum import LapNoise
from analysis.traces.loading import Measured, load_measured


@dataclass(frozen=True)
class Result:
    """A run, what its test found, and every figure of it by name."""

    measured: Measured
    found: Evaluated
    figures: dict[str, Quantity]

    @property
    def title(self) -> str:
        """`yaw acw`, say."""
        return self.measured.title

    @property
    def name(self) -> str:
        """What the run is called."""
        return self.measured.run.manifest.name

    @property
    def test(self) -> str:
        """Which test it is."""
        return self.measured.run.manifest.test

    @property
    def doubts(self) -> tuple[str, ...]:
        """What a person should know before trusting the figures, in words."""
        return (*self.measured.doubts, *doubts_of(self.measured.table, self.measured.rig), *self.found.notes)


def analyse_runs(paths: Sequence[Path]) -> list[Result]:
    """Read, align and evaluate runs; one of a single lap borrows the noise of another run of its test. Raises
    FileError."""
    results = [analyse_run(path) for path in paths]
    for place, result in enumerate(results):
        if like := _lender(result, results):
            results[place] = result_of(result.measured, like)
    return results


def analyse_run(path: Path) -> Result:
    """Read, align and evaluate a run. Raises FileError."""
    return result_of(load_measured(path))


def result_of(measured: Measured, like: tuple[LapNoise, LapNoise] | None = None) -> Result:
    """Evaluate a run that has been read; like: noise of angle and distance in another run, for one of a single lap.

    Raises FileError.
    """
    found = evaluate(measured.table, measured.rig, measured.u_lag_s, str(measured.path), like=like)
    figures = dict(found.figures)
    if isinstance(found, CircleResult):
        # The angle and the distance both show where the ball is; robot errors make them differ.
        distance = found.distance.figures
        figures |= {f"distance_{name}" if name in figures else name: figure for name, figure in distance.items()}
    figures = with_certificates(figures, measured.systematic, measured.rig, measured.run.manifest.test)
    return Result(measured, found, figures)


def _lender(result: Result, results: Sequence[Result]) -> tuple[LapNoise, LapNoise] | None:
    """Noise of angle and distance for a run of a single lap, from the first of its test that has more."""
    if not isinstance(result.found, CircleResult) or result.found.laps.count > 1:
        return None
    for other in by_test(results)[_group_of(result, results)]:
        if isinstance(other.found, CircleResult) and other.found.laps.count > 1:
            return other.found.curve.noise, other.found.distance.curve.noise
    return None


def _group_of(result: Result, results: Sequence[Result]) -> int:
    return next(k for k, group in enumerate(by_test(results)) if any(one is result for one in group))


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


def _same_cell(one: Result, other: Result) -> bool:
    rig, its = one.measured.rig, other.measured.rig
    if one.measured.run.manifest.placement != other.measured.run.manifest.placement:
        return False
    place = "circle" if isinstance(one.found, CircleResult) else "hemisphere"
    alike = rig.name == its.name and rig.robot == its.robot
    return one.test == other.test and alike and getattr(rig.tests, place) == getattr(its.tests, place)

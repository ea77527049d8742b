"""From run directories to their results: the one way that every report, plot and script takes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from analysis.reading.loading import Measured, load_measured
from analysis.reporting.certified import with_certificates
from analysis.reporting.evaluate import Evaluated, evaluate
from analysis.reporting.quantity import Quantity
from analysis.tests import circularity
from analysis.tests.circle import CircleResult
from analysis.tests.pair import Pair, pair
from analysis.tests.places import doubts_of


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


def analyse_run(path: Path) -> Result:
    """Read, align and evaluate a run. Raises FileError."""
    return result_of(load_measured(path))


def result_of(measured: Measured) -> Result:
    """Evaluate a run that has been read. Raises FileError."""
    found = evaluate(measured.table, measured.rig, measured.u_lag_s, str(measured.path))
    figures = dict(found.figures)
    if isinstance(found, CircleResult):
        distance = circularity.evaluate(found.lap, measured.u_lag_s, str(measured.path)).figures
        # The angle and the distance both tell where the ball is; robot errors make them differ.
        figures |= {f"distance_{name}" if name in figures else name: figure for name, figure in distance.items()}
    figures = with_certificates(figures, measured.systematic, measured.rig, measured.run.manifest.test)
    return Result(measured, found, figures)


def by_test(results: Sequence[Result]) -> list[list[Result]]:
    """Results in groups of one test on one rig, in the order in which they first come."""
    groups: dict[tuple[str, str], list[Result]] = {}
    for result in results:
        groups.setdefault((result.measured.rig.name, result.test), []).append(result)
    return list(groups.values())


def paired(results: Sequence[Result]) -> tuple[Result, Result] | None:
    """The first acw and the first cw run of a group; None without both, or of two circles."""
    circles = {
        result.found.lap.direction: result for result in reversed(results) if isinstance(result.found, CircleResult)
    }
    acw, cw = circles.get("acw"), circles.get("cw")
    if acw is None or cw is None or acw.measured.rig.tests.circle != cw.measured.rig.tests.circle:
        return None
    return acw, cw


def pair_of(results: Sequence[Result]) -> Pair | None:
    """Both of `paired` against each other."""
    both = paired(results)
    if both is None:
        return None
    acw, cw = both
    assert isinstance(acw.found, CircleResult) and isinstance(cw.found, CircleResult)  # noqa: S101 - by construction
    return pair(acw.found, cw.found)

"""The standing of runs against limits: every figure that has one, judged with its uncertainty, and the worst of them.

A diagnosis and the page of a report judge by this and nothing else, so that they cannot differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from analysis.measures.columns import FigureColumn, figure_columns
from analysis.measures.quantity import Quantity
from analysis.measures.results import Result, borrowers, by_test, evaluated_again, result_of
from analysis.traces.loading import Measured
from rigs.errors import RigError
from rigs.rig import Rig
from rigs.schema.limits import Limit, Limits, Standing
from rigs.schema.vocabulary import TestName

_WORST: tuple[Standing, ...] = ("fail", "watch", "pass")


@dataclass(frozen=True)
class JudgedFigure:
    """A figure of a column of a test against its limit. `straddled` states whether its uncertainty reaches over a bound
    of the limit, and `of_data_sheet` whether the limit is that of the data sheet."""

    test: TestName
    column: FigureColumn
    name: str
    figure: Quantity
    limit: Limit
    of_data_sheet: bool

    @property
    def standing(self) -> Standing:
        """Where the figure stands."""
        return self.limit.standing(self.figure.value, self.figure.u)

    @property
    def straddled(self) -> bool:
        """Whether another measurement may decide otherwise."""
        return self.limit.straddled(self.figure.value, self.figure.u)

    @property
    def excess(self) -> float:
        """Size of the figure in units of its last bound, by which the worst comes first."""
        bound = self.limit.fail if self.limit.fail is not None else self.limit.watch
        return abs(self.figure.value) / (bound or 1.0)


def judged_figures(results: Sequence[Result], limits: Limits) -> tuple[JudgedFigure, ...]:
    """Return every figure of results that has a limit, the worst first."""
    judged = []
    for group in by_test(results):
        test = group[0].measured.run.manifest.test
        for column in figure_columns(group):
            for name, figure in column.figures.items():
                if (limit := limits.of(test, name)) is not None:
                    sheet = limits.from_data_sheet(test, name)
                    judged.append(JudgedFigure(test, column, name, figure, limit, sheet))
    return tuple(sorted(judged, key=lambda one: (_WORST.index(one.standing), -one.excess)))


def standing_of(rig: Rig, runs: Sequence[Measured]) -> tuple[Standing | None, Literal["rig_file", "data_sheet"] | None]:
    """Return the worst standing of the figures of runs that have a limit, and where that comes from; None and None
    where none of them has one. Runs that cannot be evaluated have no figures, and limits are of the arm as it drives,
    not of what a calibrated model leaves of it."""
    judged = judged_figures(_evaluable(runs), rig.limits)
    if not judged:
        return None, None
    return judged[0].standing, "data_sheet" if judged[0].of_data_sheet else "rig_file"


def _evaluable(runs: Sequence[Measured]) -> list[Result]:
    """Return the results of the runs that have any, one of a single lap with the noise of another run of its test."""
    results = []
    for run in runs:
        try:
            results.append(result_of(run))
        except RigError:
            continue
    for borrower in borrowers(results):
        place, result = evaluated_again(borrower)
        results[place] = result
    return results

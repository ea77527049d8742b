"""The figures of one test side by side: a column for each direction, repeated runs as their mean, acw against cw.

Whatever is shown of figures, and whatever is judged by a limit, is of these columns.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from analysis.measures.pooled import BetweenRuns, pairs_of, pooled
from analysis.measures.quantity import Quantity
from analysis.measures.results import Result


@dataclass(frozen=True)
class FigureColumn:
    """Figures by name, of the mean of `count` runs, of one `run`, or of `count` pairs of acw and cw.

    `direction` is that of the runs, empty for pairs and where the test has none; `run` names a single run. `sd` has the
    standard deviation between runs of the figures that were repeated.
    """

    kind: Literal["mean", "run", "pairs"]
    direction: str
    count: int
    run: str
    figures: Mapping[str, Quantity]
    sd: Mapping[str, str]


def figure_columns(group: Sequence[Result]) -> list[FigureColumn]:
    """Return the columns of the runs of one test at one place."""
    together = {mean.title: mean for mean in pooled(group) if mean.figures}
    columns = []
    for title in dict.fromkeys(result.title for result in group):
        direction = title.partition(" ")[2]
        if title in together:
            columns.append(_column("mean", direction, len(together[title].runs), together[title].figures))
        else:
            runs = [result for result in group if result.title == title]
            columns += [FigureColumn("run", direction, 1, run.name, run.figures, {}) for run in runs]
    both = pairs_of(group)
    return [*columns, _column("pairs", "", len(both.runs), both.figures)] if both and both.figures else columns


def _column(
    kind: Literal["mean", "pairs"], direction: str, count: int, of_runs: Mapping[str, Quantity | BetweenRuns]
) -> FigureColumn:
    pooled_runs = {name: figure for name, figure in of_runs.items() if isinstance(figure, BetweenRuns)}
    figures = {name: figure.mean if isinstance(figure, BetweenRuns) else figure for name, figure in of_runs.items()}
    return FigureColumn(kind, direction, count, "", figures, {name: mean.in_sd for name, mean in pooled_runs.items()})

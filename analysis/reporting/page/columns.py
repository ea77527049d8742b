"""The figures of one test side by side: a column for each direction, repeated runs as their mean, acw against cw."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from analysis.measures.pooled import BetweenRuns, Pairs, pairs_of, pooled
from analysis.measures.quantity import Quantity
from analysis.measures.results import Result
from analysis.reporting.page.texts import Texts

_UNPLACED_DEG = 15.0
"""Standard uncertainty beyond which a place on the circle is no place: 2 u to either side are then a sixth of it."""


@dataclass(frozen=True)
class Column:
    """Figures by name; title: `acw`; note: what they are of; sd: between the runs, of those that were repeated."""

    title: str
    note: str
    figures: Mapping[str, Quantity]
    sd: Mapping[str, str]


def columns_of(group: Sequence[Result], texts: Texts) -> list[Column]:
    """The columns of the runs of one test."""
    together = {one.title: one for one in pooled(group) if one.figures}
    columns = []
    for title in dict.fromkeys(result.title for result in group):
        short = title.partition(" ")[2]
        if title in together:
            figures = together[title].figures
            note = texts("mean_of_runs", count=len(together[title].runs))
            columns.append(Column(short, note, _means(figures), {name: one.in_sd for name, one in figures.items()}))
        else:
            columns += [Column(short, one.name, one.figures, {}) for one in group if one.title == title]
    both = pairs_of(group)
    return [*columns, _pair(both, texts)] if both and both.figures else columns


def _pair(both: Pairs, texts: Texts) -> Column:
    figures = {name: one.mean if isinstance(one, BetweenRuns) else one for name, one in both.figures.items()}
    sd = {name: one.in_sd for name, one in both.figures.items() if isinstance(one, BetweenRuns)}
    return Column(texts("acw_against_cw"), texts("pairs", count=len(both.runs)), figures, sd)


def _means(figures: Mapping[str, BetweenRuns]) -> dict[str, Quantity]:
    return {name: one.mean for name, one in figures.items()}


def shown(name: str, figure: Quantity, texts: Texts) -> str:
    """A figure as people read it: rounded to two digits of its u; a place that may be anywhere is said to be so."""
    if name.endswith("_at_deg") and not figure.u < _UNPLACED_DEG:
        return texts("no_place")
    return str(figure)

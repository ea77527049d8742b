"""The columns of figures of one test, with their headings in the language of the page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from analysis.measures.columns import FigureColumn, figure_columns
from analysis.measures.quantity import Quantity
from analysis.measures.results import Result
from analysis.reporting.run_words import figure_in_words
from analysis.reporting.texts import Texts

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
    columns, words = [], {"mean": "mean_of_runs", "pairs": "pairs"}
    for column in figure_columns(group):
        note = column.run if column.kind == "run" else texts(words[column.kind], count=column.count)
        columns.append(Column(title_of(column, texts), note, column.figures, column.sd))
    return columns


def title_of(column: FigureColumn, texts: Texts) -> str:
    """What a column is of: a direction, or both against each other; empty where the test has no direction."""
    return texts("acw_against_cw") if column.kind == "pairs" else column.direction


def shown(name: str, figure: Quantity, texts: Texts) -> str:
    """A figure as people read it: rounded to two digits of its u; a place that may be anywhere is said to be so."""
    if name.endswith("_at_deg") and not figure.u < _UNPLACED_DEG:
        return texts("no_place")
    return figure_in_words(name, figure)

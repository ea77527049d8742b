"""Section of the page about a test: description, figures, reversals, charts and remarks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import get_args

import numpy as np

from analysis.apps.report.chart import Picture
from analysis.apps.report.model_charts import simulated_charts
from analysis.apps.report.page.page_content import Report, title_of
from analysis.apps.report.run_charts import circle_charts, joint_chart, target_charts
from analysis.apps.report.run_object import (
    eccentricities_in_words,
    figure_in_words,
    lag_in_words,
    similar_once,
    what_u_is,
)
from analysis.apps.report.texts import LEADING, Texts, in_order
from analysis.procedures.circle import CircleResult
from analysis.procedures.pooled import figure_columns, pairs_of, pooled
from analysis.procedures.results import Result, by_test
from analysis.procedures.shared.joint_reversals import angle_difference, turns
from analysis.procedures.shared.quantity import Quantity
from rigs.schema.vocabulary import TestName

_UNPLACED_DEG = 15.0
"""Standard uncertainty beyond which a place on the circle is not shown: ± 2 u would cover a sixth of the circle."""


@dataclass(frozen=True)
class SectionColumn:
    """Figures by name. title: `acw`. note: origin of the figures. sd: standard deviations between repeated runs."""

    title: str
    note: str
    figures: Mapping[str, Quantity]
    sd: Mapping[str, str]


def columns_of(group: Sequence[Result], texts: Texts) -> list[SectionColumn]:
    """Return the columns for the runs of a test."""
    columns, words = [], {"mean": "mean_of_runs", "pairs": "pairs"}
    for column in figure_columns(group):
        note = column.run if column.kind == "run" else texts(words[column.kind], count=column.count)
        columns.append(SectionColumn(title_of(column, texts), note, column.figures, column.sd))
    return columns


def format_figure(name: str, figure: Quantity, texts: Texts) -> str:
    """Return a figure rounded to two digits of u, or a remark if it is a place with too large an uncertainty."""
    if name.endswith("_at_deg") and not figure.u < _UNPLACED_DEG:
        return texts("no_place")
    return figure_in_words(name, figure)


_ORDER = get_args(TestName)
_MOST_DRAWN = 2
"""Number of drawn runs at targets: browsers show at most some sixteen rotatable charts."""
_NOMINAL_DEG = 30.0
"""Largest distance between a measured reversal and the nominal reversal of the same sense."""


@dataclass(frozen=True)
class FigureRow:
    """A figure in each column, with the standard deviation between repeated runs below."""

    label: str
    cells: tuple[tuple[str, str], ...]
    leads: bool


@dataclass(frozen=True)
class ReversalRow:
    """A reversal of a joint: measured and nominal place on the circle. upper: from increasing to decreasing angle."""

    joint: str
    measured: str
    nominal: str
    upper: bool


@dataclass(frozen=True)
class PageSection:
    """A test at a given place. words: description of the test and of the charts."""

    test: str
    title: str
    words: str
    columns: tuple[SectionColumn, ...]
    rows: tuple[FigureRow, ...]
    remarks: tuple[str, ...]
    doubts: tuple[str, ...]
    reversals: tuple[ReversalRow, ...]
    pictures: tuple[Picture, ...]


def sections_of(report: Report, texts: Texts) -> list[PageSection]:
    """Return a section for each test, in the order of the vocabulary."""
    groups = sorted(by_test(report.results), key=lambda group: _ORDER.index(group[0].test))
    first_circle = next((group for group in groups if isinstance(group[0].found, CircleResult)), None)
    joints = [joint_chart(first_circle, texts)] if first_circle else []  # yaw and roll share one circle
    sections = []
    for group in groups:
        test, place = group[0].test, group[0].measured.run.manifest.placement
        about, charts = texts.words.get(f"about_{test}", ""), list[Picture]()
        if isinstance(group[0].found, CircleResult):
            charts += circle_charts(group, texts)
        else:
            charts += [chart for result in group[:_MOST_DRAWN] for chart in target_charts(result, texts)]
            about += f" {texts('first_drawn', count=_MOST_DRAWN)}" if len(group) > _MOST_DRAWN else ""
        charts += simulated_charts(report.simulated, report.corrected, group, texts)
        # Meaning of u for these runs, and remarks on lags and pairs
        remarks = [what_u_is(group, [means for means in pooled(group) if means.figures])]
        remarks += [*lag_in_words(pairs_of(group), group), *eccentricities_in_words(group)]
        columns = columns_of(group, texts)
        section = PageSection(
            test=test,
            title=texts.test(test) + (f" · {place}" if place and place != test else ""),
            words=about,
            columns=tuple(columns),
            rows=tuple(_rows(columns, texts)),
            remarks=tuple(f"{line[:1].upper()}{line[1:]}." for line in remarks),
            doubts=_doubts(group),
            reversals=_reversals(group[0], texts),
            pictures=(*charts, *(joints if group is first_circle else ())),
        )
        sections.append(section)
    return sections


def _rows(columns: Sequence[SectionColumn], texts: Texts) -> list[FigureRow]:
    rows = []
    for name in in_order(name for column in columns for name in column.figures):
        cells = []
        for column in columns:
            figure = column.figures.get(name)
            value = format_figure(name, figure, texts) if figure else ""
            sd = column.sd.get(name, "")
            cells.append((value, f"{texts('sd')} {sd}" if sd and figure and value == str(figure) else ""))
        rows.append(FigureRow(texts.label(name), tuple(cells), name in LEADING))
    return rows


def _doubts(group: Sequence[Result]) -> tuple[str, ...]:
    """Return the limitations of the figures, each with the runs it concerns."""
    runs_of_doubt: dict[str, list[str]] = {}
    for result in group:
        for doubt in result.doubts:
            runs_of_doubt.setdefault(doubt, []).append(result.name)
    for means in pooled(group):
        for result, why in means.left_out:
            runs_of_doubt.setdefault(why, []).append(result.name)
    return tuple(f"{names}: {doubt}" for doubt, names in similar_once(runs_of_doubt))


def _reversals(result: Result, texts: Texts) -> tuple[ReversalRow, ...]:
    """Return the reversals of the joints by feedback, each with the nominal reversal."""
    if not isinstance(result.found, CircleResult):
        return ()
    rows = []
    for turn in sorted(turns(result.found.laps), key=lambda turn: turn.phi):
        candidates = [
            reversal for reversal in result.reversals if (reversal.joint, reversal.upper) == (turn.axis, turn.upper)
        ]
        away = {
            reversal.phi_deg: abs(np.degrees(angle_difference(turn.phi, np.radians(reversal.phi_deg))))
            for reversal in candidates
        }
        near = min(away, key=lambda phi: away[phi], default=None)
        nominal = f"{near:.1f}°" if near is not None and away[near] < _NOMINAL_DEG else ""
        rows.append(
            ReversalRow(
                texts.axis(result.measured.rig.robot, turn.axis), f"{np.degrees(turn.phi):.1f}°", nominal, turn.upper
            )
        )
    return tuple(rows)

"""Section of the page about a test: description, figures, reversals, charts and remarks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

import numpy as np

from analysis.apps.report.blocks import Table
from analysis.apps.report.chart import Picture
from analysis.apps.report.model_charts import simulated_charts
from analysis.apps.report.page.page_content import Report
from analysis.apps.report.run_answer import columns_of, doubt_lines, figure_table
from analysis.apps.report.run_charts import circle_charts, joint_chart, target_charts
from analysis.apps.report.run_object import eccentricities_in_words, lag_in_words, what_u_is
from analysis.apps.report.texts import Texts
from analysis.procedures.circle import CircleResult
from analysis.procedures.pooled import pairs_of, pooled
from analysis.procedures.results import Result, by_test
from analysis.procedures.shared.joint_reversals import angle_difference, turns
from rigs.schema.vocabulary import TestName

_ORDER = get_args(TestName)
_MOST_DRAWN = 2
"""Number of drawn runs at targets: browsers show at most some sixteen rotatable charts."""
_NOMINAL_DEG = 30.0
"""Largest distance between a measured reversal and the nominal reversal of the same sense."""


@dataclass(frozen=True)
class PageSection:
    """A test at a given place. words: description of the test and of the charts."""

    test: str
    title: str
    words: str
    figures: Table
    remarks: tuple[str, ...]
    doubts: tuple[str, ...]
    reversals: Table | None
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
        doubts = [(result, doubt) for result in group for doubt in result.doubts]
        doubts += [(result, why) for means in pooled(group) for result, why in means.left_out]
        section = PageSection(
            test=test,
            title=texts.test(test) + (f" · {place}" if place and place != test else ""),
            words=about,
            figures=figure_table(columns_of(group, texts), texts),
            remarks=tuple(f"{line[:1].upper()}{line[1:]}." for line in remarks),
            doubts=tuple(doubt_lines(doubts)),
            reversals=_reversals(group[0], texts),
            pictures=(*charts, *(joints if group is first_circle else ())),
        )
        sections.append(section)
    return sections


def _reversals(result: Result, texts: Texts) -> Table | None:
    """The reversals of the joints by feedback, each with the nominal reversal; None for a test without circles."""
    found = (
        sorted(turns(result.found.laps), key=lambda turn: turn.phi) if isinstance(result.found, CircleResult) else ()
    )
    rows = []
    for turn in found:
        away = {
            reversal.phi_deg: abs(np.degrees(angle_difference(turn.phi, np.radians(reversal.phi_deg))))
            for reversal in result.reversals
            if (reversal.joint, reversal.upper) == (turn.axis, turn.upper)
        }
        near = min(away, key=lambda phi: away[phi], default=None)
        nominal = f"{near:.1f}°" if near is not None and away[near] < _NOMINAL_DEG else ""
        joint, measured = texts.axis(result.measured.rig.robot, turn.axis), f"{np.degrees(turn.phi):.1f}°"
        rows.append((joint, measured, nominal, texts("upper" if turn.upper else "lower")))
    heads = tuple(map(texts, ("joint", "turns_at", "nominal", "sense")))
    return Table(heads, tuple(rows), frozenset({1, 2}), key="narrow stack") if rows else None

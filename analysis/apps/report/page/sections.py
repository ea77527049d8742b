"""The section of the page about a test: description, charts, figures, remarks and reversals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import get_args

import numpy as np

from analysis.apps.report.blocks import Block, Heading, Sentence, Table, paragraphs
from analysis.apps.report.chart import Picture
from analysis.apps.report.model_charts import simulated_charts
from analysis.apps.report.run_answer import columns_of, doubt_lines, doubts_of, figure_table, remarks_of
from analysis.apps.report.run_charts import circle_charts, joint_chart, target_charts
from analysis.apps.report.texts import Texts, capital
from analysis.diagnosis.judge.comparison import Compared
from analysis.procedures.circle import CircleResult
from analysis.procedures.results import Result, by_test
from analysis.procedures.shared.joint_reversals import angle_difference, turns
from rigs.schema.vocabulary import TestName

_ORDER = get_args(TestName)
_MOST_DRAWN = 2
"""Browsers show at most some sixteen rotatable charts."""
_NOMINAL_DEG = 30.0
"""Largest distance between a measured reversal and the nominal reversal of the same sense."""


TestSection = tuple[list[Block], list[Picture], list[Block]]
"""Blocks before the pictures of a test at a place, the pictures, and the blocks after them."""


def test_sections(
    results: Sequence[Result], simulated: Compared | None, corrected: Compared | None, texts: Texts
) -> list[TestSection]:
    """corrected: runs compared with the model including the found parts."""
    groups = sorted(by_test(results), key=lambda group: _ORDER.index(group[0].test))
    first_circle = next((group for group in groups if isinstance(group[0].found, CircleResult)), None)
    sections = []
    for group in groups:
        about, charts = texts.words.get(f"about_{group[0].test}", ""), list[Picture]()
        if isinstance(group[0].found, CircleResult):
            charts += circle_charts(group, texts)
        else:
            charts += [chart for result in group[:_MOST_DRAWN] for chart in target_charts(result, texts)]
            about += f" {texts('first_drawn', count=_MOST_DRAWN)}" if len(group) > _MOST_DRAWN else ""
        charts += simulated_charts(simulated, corrected, group, texts)
        charts += [joint_chart(group, texts)] if group is first_circle else []  # yaw and roll share one circle
        place = group[0].measured.run.manifest.placement
        title = texts.test(group[0].test) + (f" · {place}" if place and place != group[0].test else "")
        doubts = paragraphs(doubt_lines(doubts_of(group)), "doubt")
        above: list[Block] = [Heading(title), Sentence(about), *doubts]
        sections.append((above, charts, _below(group, texts)))
    return sections


def _below(group: Sequence[Result], texts: Texts) -> list[Block]:
    words = " ".join(f"{capital(line)}." for line in remarks_of(group))
    figures = figure_table(columns_of(group, texts), texts)
    blocks: list[Block] = [Heading(texts("figures"), 3), figures, Sentence(words, "note")]
    if reversals := _reversals(group[0], texts):
        blocks += [Heading(texts("reversals"), 3), Sentence(texts("about_reversals")), reversals]
    return blocks


def _reversals(result: Result, texts: Texts) -> Table | None:
    if not isinstance(result.found, CircleResult):
        return None
    rows = []
    for turn in sorted(turns(result.found.laps), key=lambda turn: turn.phi):
        near = {
            abs(np.degrees(angle_difference(turn.phi, np.radians(reversal.phi_deg)))): f"{reversal.phi_deg:.1f}°"
            for reversal in result.reversals
            if (reversal.joint, reversal.upper) == (turn.axis, turn.upper)
        }
        away_deg = min(near, default=np.inf)
        nominal = near[away_deg] if away_deg < _NOMINAL_DEG else ""
        joint, measured = texts.axis(result.measured.rig.robot, turn.axis), f"{np.degrees(turn.phi):.1f}°"
        rows.append((joint, measured, nominal, texts("upper" if turn.upper else "lower")))
    heads = tuple(map(texts, ("joint", "turns_at", "nominal", "sense")))
    return Table(heads, rows, {1, 2}, key="narrow stack") if rows else None

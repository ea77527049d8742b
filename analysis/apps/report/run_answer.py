"""The answer of analysed runs as blocks: a table of figures for each test, and remarks on uncertainties."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from analysis.apps.report.blocks import Block, Cell, Heading, Row, Sentence, Table, paragraphs
from analysis.apps.report.run_object import (
    TruthComparison,
    eccentricities_in_words,
    figure_in_words,
    lag_in_words,
    warmth_in_words,
    what_u_is,
)
from analysis.apps.report.texts import LEADING, Texts, in_order, joined, texts_of
from analysis.procedures.pooled import figure_columns, pairs_of, pooled
from analysis.procedures.results import Result, by_test
from analysis.procedures.shared.quantity import Quantity
from rigs.text import counted

_UNPLACED_DEG = 15.0
"""Standard uncertainty beyond which no place is shown: ± 2 u would cover a sixth of the circle."""


@dataclass(frozen=True)
class Column:
    """Figures by name under a title, and a line below some of them: sd between runs, or the truth."""

    title: str
    figures: Mapping[str, Quantity]
    below: Mapping[str, str]


def columns_of(group: Sequence[Result], texts: Texts) -> list[Column]:
    """The mean of repeated runs, each other run, and the comparison of both directions."""
    columns, notes = [], {"mean": "mean_of_runs", "pairs": "pairs"}
    for column in figure_columns(group):
        title = texts("acw_against_cw") if column.kind == "pairs" else column.direction
        note = column.run if column.kind == "run" else texts(notes[column.kind], count=column.count)
        below = {name: f"{texts('sd')} {sd}" for name, sd in column.sd.items()}
        columns.append(Column(joined([title, note], ", "), column.figures, below))
    return columns


def figure_table(columns: Sequence[Column], texts: Texts, *more: tuple[str, ...]) -> Table:
    rows = list[Row]()
    names = in_order(name for column in columns for name in column.figures)
    for name in names:
        cells = []
        for column in columns:
            figure = column.figures.get(name)
            is_unplaced = figure and name.endswith("_at_deg") and not figure.u < _UNPLACED_DEG
            text = texts("no_place") if is_unplaced else figure_in_words(name, figure) if figure else ""
            line = column.below.get(name, "") if figure and text == str(figure) else ""
            cells.append(Cell(text, (line,) if line else ()))
        rows.append((texts.label(name), *cells))
    ranks = (*("unusual" if name in LEADING else "" for name in names), *[""] * len(more))
    titles = (texts("value_and_u"), *(column.title for column in columns))
    return Table(titles, (*rows, *more), range(1, len(titles)), ranks, "stack")


def answer_of(
    results: Sequence[Result], truths: Sequence[dict[str, TruthComparison]] = (), *, each: bool = False
) -> list[Block]:
    """each: add a table with a column for each run, as truths always do."""
    texts, blocks = texts_of("en"), list[Block]()
    truth_of = {id(result): truth for result, truth in zip(results, truths, strict=False)}
    for group in by_test(results):
        repeated = [means for means in pooled(group) if means.figures]
        blocks.append(Heading(f"{group[0].measured.rig.name} · {texts.test(group[0].test)}"))
        if not truths:
            columns = columns_of(group, texts)
            blocks.append(figure_table(columns, texts, *([] if repeated else _facts(group, len(columns)))))
        if truths or (each and repeated):
            columns = []
            for result in group:
                below = {
                    name: f"truth {result.figures[name].rounded(one.truth)} ({one.deviation_u:+z.1f}u)"
                    for name, one in truth_of.get(id(result), {}).items()
                    if name in result.figures
                }
                columns.append(Column(f"{result.title}, {result.name}", result.figures, below))
            blocks.append(figure_table(columns, texts, *_facts(group, len(columns))))
        hint = "; --each shows the single runs" if repeated and not each else ""
        first, *remarks = remarks_of(group)
        blocks += paragraphs((first + hint, *remarks), "note")
    if truths:
        agree = [abs(one.deviation_u) <= 2 for by_name in truths for one in by_name.values()]
        verdict = f"{sum(agree)} of {len(agree)} figures agree with the truth within 2 u"
        blocks.append(Sentence(verdict, "pass" if all(agree) else "fail"))
    doubts = [doubt for group in by_test(results) for doubt in doubts_of(group)]
    return [*blocks, *paragraphs(doubt_lines(doubts, with_title=True), "doubt")]


def _facts(group: Sequence[Result], columns: int) -> list[tuple[str, ...]]:
    rows = [("samples", *(f"{result.found.samples}" for result in group))]
    if any(result.measured.u_lag_s for result in group):  # uncertainty of the time of the gauges relative to the robot
        rows.append(("time, gauges to robot", *(f"± {result.measured.u_lag_s * 1e3:.1f} ms" for result in group)))
    return [(*row, *[""] * (columns - len(group))) for row in rows]


def remarks_of(group: Sequence[Result]) -> list[str]:
    lines = (*lag_in_words(pairs_of(group), group), *eccentricities_in_words(group), *warmth_in_words(group))
    return [what_u_is(group), *lines]


def doubts_of(group: Sequence[Result]) -> list[tuple[Result, str]]:
    doubts = [(result, doubt) for result in group for doubt in result.doubts]
    return doubts + [(result, why) for means in pooled(group) for result, why in means.left_out]


def doubt_lines(doubts: Sequence[tuple[Result, str]], *, with_title: bool = False) -> list[str]:
    """Each doubt with its runs. Doubts that differ only in figures appear once."""
    runs_of_doubt: dict[str, list[str]] = {}
    for result, doubt in doubts:
        runs_of_doubt.setdefault(doubt, []).append(f"{result.title}, {result.name}" if with_title else result.name)
    alike: dict[str, list[str]] = {}
    for doubt in runs_of_doubt:
        alike.setdefault(_FIGURE.sub("0", doubt), []).append(doubt)
    lines = []
    for first, *others in alike.values():
        count = sum(len(runs_of_doubt[doubt]) for doubt in others)
        similar = f" (similar in {counted(count, 'more run')})" if count else ""
        lines.append(f"{', '.join(runs_of_doubt[first])}{similar}: {first}")
    return lines


_FIGURE = re.compile(r"-?\d+\.\d+")

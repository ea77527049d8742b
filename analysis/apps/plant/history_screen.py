"""The answer of a history as blocks, as JSON and as a table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pyarrow as pa

from analysis.apps.plant.before_after import Difference, headlines
from analysis.apps.plant.history import History, Series, judge, label_of
from analysis.apps.plant.history_words import against_limit, dates, doubts, origin, remarks, sentences, too_few
from analysis.apps.report.blocks import Block, Cell, Figure, Heading, Sentence, Table
from analysis.procedures.shared.quantity import Quantity
from analysis.robot.kinematics.arm import Array
from analysis.runs.tabular import for_json, table_of_rows

_BARS = "▁▂▃▄▅▆▇█"
_WIDTH = 20
"""Characters of a sparkline; each is the median of an equal share of the runs."""


def answer_of(
    history: History, figures: Sequence[Figure] = (), left_out: int = 0, *, dated: bool = False
) -> list[Block]:
    """The sentences, a row for each figure, the pictures on a page, and remarks.

    left_out: number of figures whose picture is left out. dated: add the times of runs to their figures.
    """
    lines = [*doubts(history), *[f"{left_out} further figures without a change are not shown."] * (left_out > 0)]
    days = [run.when.date() for series in history.series for run in series.runs]
    span = sorted({str(min(days)), str(max(days))}) if days else []
    title = " · ".join([history.robot, *filter(None, [" to ".join(span)])])
    return [
        *(Sentence(sentence, "strong") for sentence in sentences(history) or [too_few(history)]),
        *(Sentence(line, "doubt") for line in (origin(history), *lines) if line),
        Heading(title),
        _table(history.series, dated=dated),
        *figures,
        *([Sentence(_LEGEND, "note")] if figures else []),
        *(Sentence(line, "note") for line in (*remarks(history), _U)),
    ]


_LEGEND = (
    "Dots: runs, with bars of 2 u. Crosses: outliers. Orange: a change. Dashed line: fail limit; dotted line: watch "
    "limit. Vertical line: day on which something moved."
)
_U = "u is the standard uncertainty of a figure within a run. It does not include the scatter between runs."


def _table(all_series: Sequence[Series], *, dated: bool) -> Table:
    """A row per figure: the value for single runs, otherwise first, last and a sparkline."""
    is_one = all(len(series.runs) == 1 for series in all_series)
    is_limited = any(series.limit for series in all_series)
    columns = ["test", "figure", *(("value ± u",) if is_one else ("runs", "first", "last", "spread", "course", ""))]
    rows: list[tuple[str | Cell, ...]] = []
    title_before = ""
    for series in all_series:
        quantities, spread = series.quantities, series.trend.spread
        begin, end = (Cell("", (f"{run.when:%Y-%m-%d %H:%M}",) * dated) for run in (series.runs[0], series.runs[-1]))
        cells = [replace(begin, text=str(quantities[0]))]
        if not is_one:
            by = Quantity(0.0, spread if spread > 0 else quantities[-1].u, quantities[-1].unit)
            rounded = by.rounded_size(spread) if np.isfinite(spread) else "–"
            ways = "".join("↑" if change.after > change.before else "↓" for change in series.trend.changes)
            first, last = by.rounded(quantities[0].value), str(quantities[-1])
            ends = replace(begin, text=first), replace(end, text=last)
            cells = [Cell(f"{len(quantities)}"), *ends, *map(Cell, (rounded, sparkline(series.values), ways))]
        if is_limited:
            cells.append(Cell(against_limit(series, dated=False)))
        rows.append(("" if series.title == title_before else series.title, series.label, *cells))
        title_before = series.title
    ranks = tuple("unusual" if series.trend.changes else "" for series in all_series)
    heads = (*columns, *["limit"] * is_limited)
    return Table(heads, tuple(rows), frozenset({2} if is_one else {2, 3, 4, 5}), ranks)


def differences_answer(compared: Sequence[Difference]) -> list[Block]:
    """A sentence per changed figure, and a row per compared figure."""
    rows, title = [], ""
    for difference in compared:
        by = difference.difference
        is_known = bool(np.isfinite(by.u))
        verdict = ("yes" if difference.is_larger else "no") if is_known else "unknown: repeat the runs"
        cells = [by.rounded(value) for value in (difference.before, difference.after, by.value)]
        cells += [by.rounded_u, by.sign, by.rounded(difference.explained)] if is_known else ["", by.sign, ""]
        name = "" if difference.title == title else difference.title
        rows.append((name, label_of(difference.figure), *cells, verdict))
        title = difference.title
    before = max(difference.runs_before for difference in compared)
    counts = f"runs: {before} before, {max(difference.runs_after for difference in compared)} after"
    u = f"u: standard uncertainty by the spread between runs; explained: largest difference by that spread; {counts}"
    heads = ("", "", "before", "after", "difference", "u", "", "explained", "more than that")
    ranks = tuple("unusual" if difference.is_larger else "" for difference in compared)
    table = Table(heads, tuple(rows), frozenset({2, 3, 4, 5, 7}), ranks)
    return [*(Sentence(sentence, "strong") for sentence in headlines(compared)), table, Sentence(u, "note")]


def sparkline(values: Array) -> str:
    """Values (n,) from smallest to largest; flat for equal values."""
    pieces = np.array_split(values, min(_WIDTH, len(values)))
    heights = np.array([np.median(piece) for piece in pieces])
    low, span = heights.min(), np.ptp(heights)
    if span == 0:
        return _BARS[0] * len(heights)
    return "".join(_BARS[round(float((height - low) / span) * (len(_BARS) - 1))] for height in heights)


def as_object(history: History) -> dict[str, Any]:
    """Plain values for scripts: every point, every change, and runs with no figures."""
    plain: dict[str, Any] = for_json(
        {
            "robot": history.robot,
            "origin": origin(history),
            "sentences": sentences(history),
            "remarks": remarks(history),
            "movements": [
                {"run": marked.run, "started": marked.when.isoformat()}
                | {key: getattr(marked.check, key) for key in ("reference", "axis", "probability", "answer")}
                | {key: getattr(marked.check, key) or None for key in ("what", "name")}
                for marked in history.collected.checks
            ],
            "series": [_series_object(series) for series in history.series],
            "without_figures": {record.name: record.problem for record in history.collected.broken},
            "notes": list(history.collected.notes),
        }
    )
    return plain


def _series_object(series: Series) -> dict[str, Any]:
    changes = [
        {
            "after_run": series.runs[change.first].name,
            "by_run": series.runs[change.last].name,
            "when": dates(series, change),
            "before": change.before,
            "after": change.after,
            "u": change.u,
            "chance": change.chance,
            "may_go_on": change.is_last,
        }
        for change in series.trend.changes
    ]
    judged = judge(series)
    limit = judged and {
        "watch": judged.limit.watch,
        "fail": judged.limit.fail,
        "standing": judged.standing,
        "since": judged.since.started,
        "since_run": judged.since.name,
        "beyond": [run.name for run in judged.beyond],
    }
    names = {"title": series.title, "figure": series.figure, "spread": series.trend.spread}
    return names | {"points": _points(series), "changes": changes, "limit": limit}


def _points(series: Series) -> list[dict[str, Any]]:
    return [
        {"run": run.name, "started": run.started, "value": quantity.value, "u": quantity.u, "alone": bool(is_outlier)}
        for run, quantity, is_outlier in zip(series.runs, series.quantities, series.trend.wild, strict=True)
    ]


def as_table(all_series: Sequence[Series]) -> pa.Table:
    columns = ("title", "figure", "run", "started", "value", "u", "alone")
    rows = [
        {"title": series.title, "figure": series.figure} | point for series in all_series for point in _points(series)
    ]
    return table_of_rows(columns, rows)

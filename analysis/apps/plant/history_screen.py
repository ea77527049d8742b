"""History on a terminal, as JSON and as a table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from analysis.apps.plant.before_after import Difference, headlines
from analysis.apps.plant.collect import MarkedCheck
from analysis.apps.plant.history import History, Series, judge, label_of
from analysis.apps.plant.history_words import against_limit, dates, doubts, origin, remarks, sentences, too_few
from analysis.cli.plain_console import fold_long_words
from analysis.procedures.shared.quantity import Quantity
from analysis.robot.kinematics.arm import Array
from analysis.runs.tabular import for_json, table_of_rows

_BARS = "▁▂▃▄▅▆▇█"
_WIDTH = 20
"""Number of characters of a sparkline; each is the median of an equal share of the runs."""


def as_screen(history: History) -> RenderableType:
    """Return the sentences, a line for each figure, and remarks."""
    head = [Text(line, style="yellow") for line in filter(None, [origin(history)])]
    head += [Text(sentence, style="bold") for sentence in sentences(history) or [too_few(history)]]
    lines = [Text(line, style="dim") for line in remarks(history)]
    days = [run.when.date() for series in history.series for run in series.runs]
    span = sorted({str(min(days)), str(max(days))}) if days else []
    title = " · ".join([history.robot, *filter(None, [" to ".join(span)])])
    doubtful = [Text(line, style="yellow") for line in doubts(history)]
    return Group(*head, fold_long_words(_table(history.series, title)), *lines, *doubtful)


def _table(all_series: Sequence[Series], title: str) -> Table:
    """Return a table with a line per figure: the value for single runs, otherwise first, last and a sparkline."""
    table = Table(title=title, title_style="dim", header_style="bold", box=None, padding=(0, 1))
    table.add_column("")
    table.add_column("")
    is_one = all(len(series.runs) == 1 for series in all_series)
    for heading in ("value ± u",) if is_one else ("runs", "first", "last", "spread"):
        table.add_column(heading, justify="right", no_wrap=True)
    if not is_one:
        table.add_column("course", no_wrap=True)
        table.add_column("")
    is_limited = any(series.limit for series in all_series)
    if is_limited:
        table.add_column("limit")
    title_before = ""
    for series in all_series:
        quantities, spread = series.quantities, series.trend.spread
        cells = [str(quantities[0])]
        if not is_one:
            by = Quantity(0.0, spread if spread > 0 else quantities[-1].u, quantities[-1].unit)
            first, last = (by.rounded(quantity.value) for quantity in (quantities[0], quantities[-1]))
            rounded = by.rounded_size(spread) if np.isfinite(spread) else "–"
            ways = "".join("↑" if change.after > change.before else "↓" for change in series.trend.changes)
            cells = [str(len(quantities)), first, f"{last} {series.unit}", rounded, sparkline(series.values), ways]
        if is_limited:
            cells.append(against_limit(series).partition(" since")[0])
        name = "" if series.title == title_before else series.title
        table.add_row(name, series.label, *cells, style="bold" if series.trend.changes else "")
        title_before = series.title
    return table


def as_differences(compared: Sequence[Difference]) -> RenderableType:
    """Return the comparison around a repair: a sentence per changed figure, and a line per compared figure."""
    found_first = [Text(sentence, style="bold") for sentence in headlines(compared)]
    table = Table(header_style="bold", box=None, padding=(0, 1))
    table.add_column("")
    table.add_column("")
    for heading in ("before", "after", "difference", "u"):
        table.add_column(heading, justify="right")
    table.add_column("")
    table.add_column("explained", justify="right")
    table.add_column("more than that")
    title = ""
    for difference in compared:
        by = difference.difference
        is_known = bool(np.isfinite(by.u))
        verdict = ("yes" if difference.is_larger else "no") if is_known else "unknown: repeat the runs"
        cells = [by.rounded(value) for value in (difference.before, difference.after, by.value)]
        cells += [by.rounded_u, by.sign, by.rounded(difference.explained)] if is_known else ["", by.sign, ""]
        cells.append(verdict)
        name = "" if difference.title == title else difference.title
        table.add_row(name, label_of(difference.figure), *cells, style="bold" if difference.is_larger else "")
        title = difference.title
    before = max(difference.runs_before for difference in compared)
    counts = f"runs: {before} before, {max(difference.runs_after for difference in compared)} after"
    u = f"u: standard uncertainty by the spread between runs; explained: largest difference by that spread; {counts}"
    return Group(*found_first, fold_long_words(table), Text(u, style="dim"))


def sparkline(values: Array) -> str:
    """Return a sparkline of values (n,) in any unit, from smallest to largest; flat for equal values."""
    pieces = np.array_split(values, min(_WIDTH, len(values)))
    heights = np.array([np.median(piece) for piece in pieces])
    low, span = heights.min(), np.ptp(heights)
    if span == 0:
        return _BARS[0] * len(heights)
    return "".join(_BARS[round(float((height - low) / span) * (len(_BARS) - 1))] for height in heights)


def as_object(history: History) -> dict[str, Any]:
    """Return plain values for scripts: every point, every change, and runs with no figures. Figure names contain the
    units."""
    plain: dict[str, Any] = for_json(
        {
            "robot": history.robot,
            "origin": origin(history),
            "sentences": sentences(history),
            "remarks": remarks(history),
            "movements": [_movement_object(check) for check in history.collected.checks],
            "series": [_series_object(series) for series in history.series],
            "without_figures": {record.name: record.problem for record in history.collected.broken},
            "notes": list(history.collected.notes),
        }
    )
    return plain


def _movement_object(marked: MarkedCheck) -> dict[str, Any]:
    check = marked.check
    return {
        "run": marked.run,
        "started": marked.when.isoformat(),
        "reference": list(check.reference),
        "what": check.what or None,
        "axis": check.axis,
        "name": check.name or None,
        "probability": check.probability,
        "answer": check.answer,
    }


def _series_object(series: Series) -> dict[str, Any]:
    """Return the points of a series, the changes, and the standing; None if it has no limit."""
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
    """Return a row per run and figure: title, figure, run, started, value, u, alone."""
    columns = ("title", "figure", "run", "started", "value", "u", "alone")
    rows = [
        {"title": series.title, "figure": series.figure} | point for series in all_series for point in _points(series)
    ]
    return table_of_rows(columns, rows)

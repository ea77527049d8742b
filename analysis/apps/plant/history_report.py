"""The answer of a history as blocks, as JSON, as a table, and as a page with a picture of each figure over time."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from markupsafe import Markup

from analysis.apps.plant.changes import Change
from analysis.apps.plant.history import History, Series, judge
from analysis.apps.plant.history_sentences import against_limit, dates, doubts, origin, remarks, sentences, too_few
from analysis.apps.report.blocks import Block, Cell, Figure, Heading, Row, Sentence, Table, paragraphs
from analysis.apps.report.html_page import answer_page, write_html
from analysis.apps.report.texts import joined
from analysis.procedures.shared.quantity import Quantity
from analysis.robot.kinematics.arm import Array
from analysis.runs.tabular import pick_fields, table_of_rows
from rigs.text import counted

_BARS = "▁▂▃▄▅▆▇█"
_CARDS = "stack"
"""Class of a table whose rows are cards on a telephone (report.css)."""
_WIDTH = 20
"""Bars of a sparkline; each is the median of an equal share of the runs."""


def history_answer(history: History) -> list[Block]:
    return [
        *_lead(history),
        Heading(_heading(history)),
        _table(history.series, dated=False),
        *paragraphs([*remarks(history), _U], "note"),
    ]


def _lead(history: History) -> list[Block]:
    return [
        *paragraphs([origin(history)], "doubt"),
        *paragraphs(sentences(history) or [too_few(history)], "strong"),
        *paragraphs(doubts(history), "doubt"),
    ]


def _heading(history: History) -> str:
    days = sorted({f"{run.when.date()}" for series in history.series for run in series.runs})
    return joined([history.robot, " to ".join(dict.fromkeys([*days[:1], *days[-1:]]))], " · ")


def _changed_table(history: History) -> list[Block]:
    """The significant changes, one per row; nothing without one."""
    rows = [_change_row(series, change) for series, change in history.changed]
    columns = ["test", "figure", "before", "after", "change ± u", "when"]
    return [Heading("What changed"), Table(columns, rows, {2, 3, 4}, key=_CARDS)] if rows else []


def _change_row(series: Series, change: Change) -> Row:
    by = Quantity(change.after - change.before, change.u, series.unit)
    levels = map(by.rounded, (change.before, change.after))
    return (series.title, series.label, *levels, str(by), dates(series, change))


_LEGEND = (
    "Dots: runs, with bars of 2 u. Crosses: outliers. Orange: a change. Dashed line: fail limit; dotted line: watch "
    "limit. Vertical line: day on which something moved."
)
_U = "u is the standard uncertainty of a figure within a run. It does not include the scatter between runs."


def _table(all_series: Sequence[Series], *, dated: bool) -> Table:
    is_one = all(len(series.runs) == 1 for series in all_series)
    columns = ["test", "figure", *(["value ± u"] if is_one else ["runs", "first", "last", "spread", "course", ""])]
    rows, titles = list[Row](), [series.title for series in all_series]
    for series, before in zip(all_series, ["", *titles], strict=False):
        first, last, spread = series.quantities[0], series.quantities[-1], series.trend.spread
        begin, end = ([f"{run.when:%Y-%m-%d %H:%M}"] * dated for run in (series.runs[0], series.runs[-1]))
        cells: list[str | Cell] = [Cell(str(first), begin)]
        if not is_one:
            by = Quantity(0.0, spread if spread > 0 else last.u, last.unit)
            rounded = by.rounded_size(spread) if np.isfinite(spread) else "–"
            ways = "".join("↑" if change.after > change.before else "↓" for change in series.trend.changes)
            ends = Cell(str(first) if dated else by.rounded(first.value), begin), Cell(str(last), end)
            cells = [f"{len(series.runs)}", *ends, rounded, sparkline(series.values), ways]
        title = "" if series.title == before and not dated else series.title  # on a page each row may be a card
        rows.append((title, series.label, *cells, against_limit(series, dated=False)))
    ranks = ["unusual" if series.trend.changes else "" for series in all_series]
    if any(series.limit for series in all_series):
        columns.append("limit")
    return Table(columns, [row[: len(columns)] for row in rows], {2} if is_one else {2, 3, 4, 5}, ranks, key=_CARDS)


def sparkline(values: Array) -> str:
    pieces = np.array_split(values, min(_WIDTH, len(values)))
    heights = np.array([np.median(piece) for piece in pieces])
    low, span = heights.min(), np.ptp(heights)
    if span == 0:
        return _BARS[0] * len(heights)
    return "".join(_BARS[round(float((height - low) / span) * (len(_BARS) - 1))] for height in heights)


def as_object(history: History) -> dict[str, Any]:
    checked = ("reference", "axis", "probability", "answer")
    return {
        "robot": history.robot,
        "origin": origin(history),
        "sentences": sentences(history),
        "remarks": remarks(history),
        "movements": [
            {"run": marked.run, "started": marked.when.isoformat(), **pick_fields(marked.check, *checked)}
            | {"what": marked.check.what or None, "name": marked.check.name or None}
            for marked in history.collected.checks
        ],
        "series": [_series_object(series) for series in history.series],
        "without_figures": {record.name: record.problem for record in history.collected.broken},
        "notes": history.collected.notes,
    }


def _series_object(series: Series) -> dict[str, Any]:
    changes = [
        {
            "after_run": series.runs[change.first].name, "by_run": series.runs[change.last].name,
            "when": dates(series, change), **pick_fields(change, "before", "after", "u", "chance"),
            "may_go_on": change.is_last,
        }
        for change in series.trend.changes
    ]  # fmt: skip
    judged = judge(series)
    limit = judged and {
        **pick_fields(judged.limit, "watch", "fail"), "standing": judged.standing,
        "since": judged.since.started, "since_run": judged.since.name, "beyond": [run.name for run in judged.beyond],
    }  # fmt: skip
    about = pick_fields(series, "title", "figure") | {"spread": series.trend.spread}
    return about | {"points": _points(series), "changes": changes, "limit": limit}


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


_MOST = 60
"""Pictures on a page, changes and exceeded limits first: about 20 kB each."""
_IN_SIGHT = 2.0
"""Multiple of the largest run below which a limit is drawn; otherwise the runs would look flat."""
_INK, _CHANGE, _OUTLIER, _LIMIT = "#1f5fa8", "#d95f02", "#999999", "#222222"


def write_page(history: History, path: Path, *, made_of: str = "", overview: str = "") -> None:
    """Write a page that shows what changed. All figures and the other pictures follow behind headings.

    made_of: digest of the inputs. overview: address of a linked page.
    """
    # A single run, or simultaneous runs, have no time axis.
    timed = [series for series in history.series if len({run.when for run in series.runs}) > 1]
    drawn = sorted(timed, key=_order)
    moved = [check.when for check in history.collected.checks if check.has_moved]
    figures = [(series, Figure(_caption(series), _picture(series, moved))) for series in drawn[:_MOST]]
    blocks = [*_lead(history), *_changed_table(history)]
    blocks += [figure for series, figure in figures if series.trend.changes]
    blocks += paragraphs([_LEGEND if figures else "", *remarks(history), _U], "note")
    others = [(series.title, figure) for series, figure in figures if not series.trend.changes]
    sections: list[tuple[str, Sequence[Block]]] = [
        ("All figures", [Heading(_heading(history)), _table(history.series, dated=True)])
    ]
    for test in dict.fromkeys(title for title, _ in others):
        own = [figure for title, figure in others if title == test]
        sections.append((f"{test}: {counted(len(own), 'figure')} without a change", own))
    if left_out := len(drawn) - len(figures):
        blocks += paragraphs([f"{counted(left_out, 'further picture')} without a change: not drawn."], "note")
    boxed = sum(isinstance(block, Sentence) and block.tone == "strong" for block in blocks) + bool(origin(history))
    title = f"{history.robot}: history"
    page = answer_page(title, blocks, boxed=boxed, made_of=made_of, overview=overview, sections=sections)
    write_html(page, path)


def _order(series: Series) -> tuple[bool, bool]:
    """Changes first, then exceeded limits."""
    judged = judge(series)
    return not series.trend.changes, judged is None or judged.standing != "fail"


def _caption(series: Series) -> str:
    limit = f"; limit: {against_limit(series)}" if series.limit else ""
    return f"{series.title}: {series.label}, {counted(len(series.runs), 'run')}{limit}"


def _picture(series: Series, moved: Sequence[datetime]) -> Markup:
    """moved: times of movements."""
    import matplotlib as mpl  # noqa: PLC0415 - slow to import

    from analysis.apps.report.chart import Sheet, svg_of  # noqa: PLC0415

    when, values, wild = np.array([run.when for run in series.runs]), series.values, series.trend.wild
    u = np.nan_to_num(np.array([quantity.u for quantity in series.quantities]), posinf=0.0)
    figure = Sheet(5.0, 1.9)
    axes = figure.subplots()
    with mpl.rc_context({"date.converter": "concise"}):  # years, days or times, depending on the range
        axes.errorbar(when[~wild], values[~wild], 2 * u[~wild], fmt=".", ms=3, lw=0.6, color=_INK)
    axes.plot(when[wild], values[wild], "x", ms=4, color=_OUTLIER)
    axes.set_xlim(*axes.get_xlim())  # those of the runs
    for change in series.trend.changes:
        ends = [when[change.first], when[change.last]]
        axes.plot(ends, [change.before, change.after], "-o", ms=3, color=_CHANGE, lw=1.8)
    bounds = {":": series.limit.watch, "--": series.limit.fail} if series.limit else {}
    for style, bound in bounds.items():
        if bound is not None and bound <= _IN_SIGHT * np.max(np.abs(values)):
            for side in np.unique(np.sign(values[values != 0])):  # A limit applies to the absolute value.
                axes.axhline(side * bound, ls=style, lw=1.0, color=_LIMIT)
    for time in moved:
        axes.axvline(time, ls="-.", lw=1.0, color=_CHANGE)  # type: ignore[arg-type]
    axes.set_ylabel(series.unit)
    axes.grid(color="#dddddd", lw=0.5)
    axes.spines[["top", "right"]].set_visible(False)
    # The SVG only contains axis numbers and units, escaped by matplotlib.
    return Markup(svg_of(figure, series.figure))  # noqa: S704

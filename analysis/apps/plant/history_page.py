"""History as a self-contained page: sentences, and a picture of each figure over time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from markupsafe import Markup
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter

from analysis.apps.plant.history import History, Series, judge
from analysis.apps.plant.history_screen import answer_of
from analysis.apps.plant.history_words import against_limit
from analysis.apps.report.blocks import Figure, Sentence
from analysis.apps.report.html_page import answer_page, write_html
from analysis.apps.report.still_chart import Sheet, svg_of
from rigs.text import counted

_MOST = 60
"""Pictures on a page, exceeded limits and changes first: about 20 kB each."""
_IN_SIGHT = 2.0
"""A limit is drawn if it is below this multiple of the largest run; otherwise the runs would look flat."""
_DAY_S = 86400.0
_MARGIN = 0.04
"""Free margin on either side, as a share of the time span."""
_INK, _CHANGE, _OUTLIER, _LIMIT = "#1f5fa8", "#d95f02", "#999999", "#222222"


def write_page(history: History, path: Path, *, made_of: str = "", overview: str = "") -> None:
    """Write the page. made_of: digest of the inputs. overview: address of a linked page."""
    shown = sorted(history.series, key=lambda series: (not _is_beyond(series), not series.trend.changes))
    # A single run, or simultaneous runs, have no time axis.
    drawn = [series for series in shown if len({run.when for run in series.runs}) > 1]
    moved = [check.when.timestamp() / _DAY_S for check in history.collected.checks if check.has_moved]
    figures = [Figure(_caption(series), _picture(series, moved)) for series in drawn[:_MOST]]
    answer = answer_of(history, figures, max(0, len(drawn) - _MOST), dated=True)
    boxed = sum(isinstance(block, Sentence) and block.tone == "strong" for block in answer)
    title = f"{history.robot}: history"
    write_html(answer_page(title, answer, boxed=boxed, made_of=made_of, overview=overview), path)


def _caption(series: Series) -> str:
    limit = f"; limit: {against_limit(series)}" if against_limit(series) else ""
    return f"{series.title}: {series.label}, {counted(len(series.runs), 'run')}{limit}"


def _is_beyond(series: Series) -> bool:
    judged = judge(series)
    return judged is not None and judged.standing == "fail"


def _picture(series: Series, moved: Sequence[float]) -> Markup:
    """SVG of a figure over time: runs with 2 u, detected levels, outliers as crosses, and movements.

    moved: times of movements in days since 1970.
    """
    when = np.array([run.when.timestamp() / _DAY_S for run in series.runs])  # Matplotlib's days since 1970
    values, wild = series.values, series.trend.wild
    u = np.nan_to_num(np.array([quantity.u for quantity in series.quantities]), posinf=0.0)
    figure = Sheet(8, 2.2)
    axes = figure.subplots()
    axes.errorbar(when[~wild], values[~wild], 2 * u[~wild], fmt=".", ms=3, lw=0.6, color=_INK)
    axes.plot(when[wild], values[wild], "x", ms=4, color=_OUTLIER)
    for change in series.trend.changes:
        ends = [when[change.first], when[change.last]]
        axes.plot(ends, [change.before, change.after], "-o", ms=3, color=_CHANGE, lw=1.8)
    bounds = ((series.limit.watch, ":"), (series.limit.fail, "--")) if series.limit else ()
    for bound, style in bounds:
        if bound is not None and bound <= _IN_SIGHT * np.max(np.abs(values)):
            for side in (1, -1):  # A limit applies to the absolute value.
                if np.any(side * values > 0):
                    axes.axhline(side * bound, ls=style, lw=1.0, color=_LIMIT)
    for day in moved:
        axes.axvline(day, ls="-.", lw=1.0, color=_CHANGE)
    axes.set_xlim(when[0] - _MARGIN * np.ptp(when), when[-1] + _MARGIN * np.ptp(when))
    # Label the time axis with years, days or times, depending on the range.
    zone = series.runs[-1].when.tzinfo
    ticks = AutoDateLocator(tz=zone, minticks=2, maxticks=7)  # type: ignore[no-untyped-call]
    axes.xaxis.set_major_locator(ticks)
    axes.xaxis.set_major_formatter(ConciseDateFormatter(ticks, tz=zone))  # type: ignore[no-untyped-call]
    axes.set_ylabel(series.unit)
    axes.grid(color="#dddddd", lw=0.5)
    axes.spines[["top", "right"]].set_visible(False)
    # The SVG only contains axis numbers and units, escaped by matplotlib.
    return Markup(svg_of(figure, series.figure))  # noqa: S704

"""What people read of analysed runs: tables.

What is said of analysed runs of one test: what their uncertainties mean, and acw against cw.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.table import Table
from rich.text import Text

from analysis.measures.link_angle import CircleResult
from analysis.measures.pooled import ONE_RUN, BetweenRuns, Pairs, Pooled, pairs_of, pooled
from analysis.measures.quantity import Quantity
from analysis.measures.results import Result, by_test
from analysis.reporting.labels import LEADING, in_order, label, whole_label
from analysis.reporting.plain_console import whole
from analysis.reporting.truth import TruthComparison, all_agree, verdict

_LARGEST_OF_NOISE = ("hysteresis_max_deg", "hysteresis_max_mm")
_BEYOND = 4.0
"""Standard uncertainties beyond which two eccentricities are not of one ball by chance. Chosen: odds of 10 000 to 1."""


def what_u_is(group: Sequence[Result], repeated: Sequence[Pooled]) -> str:
    """What the uncertainties of a group mean: of means, and of runs that nothing repeats."""
    if not repeated:
        return ONE_RUN
    runs = " and ".join(f"{len(mean.runs)} runs {mean.title}" for mean in repeated)
    means = f"{runs}: mean ± standard uncertainty of the mean, sd between the runs"
    titles = dict.fromkeys(result.title for result in group)
    single = [title for title in titles if title not in {mean.title for mean in repeated}]
    return f"{means}; {' and '.join(single)}: {ONE_RUN}" if single else means


def figure_in_words(name: str, figure: Quantity | BetweenRuns) -> str:
    """A figure as people read it. Where the largest hysteresis is smaller than u it is noise, and no more than u is
    known of it."""
    value = figure.mean if isinstance(figure, BetweenRuns) else figure
    if name in _LARGEST_OF_NOISE and value.value < value.u < np.inf:
        return f"≤ {value.rounded_u} {value.sign}"
    return str(figure)


def eccentricities_in_words(group: Sequence[Result]) -> list[str]:
    """Why the eccentricities by angle and by distance differ, in a line, where they do by more than noise explains."""
    apart = []
    for result in group:
        angle, distance = (result.figures.get(f"{by}eccentricity_mm") for by in ("", "distance_"))
        if angle is None or distance is None:
            continue
        u = float(np.hypot(angle.u, distance.u))
        away = abs(angle.value - distance.value)
        if np.isfinite(u) and away > _BEYOND * u:
            apart.append((away, away / u))
    if not apart:
        return []
    away, times = max(apart)
    return [
        f"the eccentricities by angle and by distance differ by up to {away:.3f} mm, {times:.0f} u: u holds the noise "
        "of the readings, and not the arm's own error once a lap, which turns the tool and shifts its circle by "
        "different amounts; the ball's own place is known to about that difference"
    ]


def pairs_in_words(both: Pairs | None) -> list[str]:
    """acw against cw in a line, if there is such a pair."""
    if both is None or both.lag is None:
        return []
    figures = "; ".join(
        f"{whole_label(name)} {figure_in_words(name, both.figures[name])}" for name in in_order(both.figures)
    )
    count = f" ({len(both.runs)} pairs)" if len(both.runs) > 1 else ""
    return [f"acw against cw{count}: {figures}"]


def lag_in_words(both: Pairs | None, group: Sequence[Result]) -> list[str]:
    """The lag of the gauges, and which runs are not a pair, one line each."""
    if not isinstance(group[0].found, CircleResult):
        return []
    if both is None:
        return ["one direction cannot show a lag between gauges and robot: analyse acw and cw together"]
    return [*both.refused, *([_of_lag(both.lag, _rate(both))] if both.lag is not None else [])]


def warmth_in_words(group: Sequence[Result]) -> list[str]:
    """How warm the joints of each run were, where its robot showed it, one line each."""
    lines = []
    for result in group:
        if warmth := result.measured.condition.warmth:
            means, rises = ([getattr(warming, key) for warming in warmth.values()] for key in ("mean_c", "rise_c"))
            most = max(rises, key=abs)
            line = f"{result.title}, {result.name}: joints {min(means):.1f} to {max(means):.1f} °C in the mean"
            lines.append(f"{line}; axis {list(warmth)[rises.index(most)]} changed by {most:+.1f} °C within the run")
    return lines


def _rate(both: Pairs) -> float:
    """How fast the circle was driven, rad/s."""
    figures = both.runs[0][0].found
    return abs(figures.curve.rate) if isinstance(figures, CircleResult) else 0.0


def _of_lag(lag: Quantity, rate: float) -> str:
    if abs(lag.value) < 2 * lag.u:
        return f"a lag of the gauges behind the robot is not detected: {lag}"
    turned = np.degrees(rate * abs(lag.value) / 1000)
    return (
        f"the gauges lag the robot by {lag}: the shifts of acw and cw are off by {turned:.2g}° in opposite directions, "
        "which their u does not include; describe the gauge by `timing` in the rig file, or run rig diagnose"
    )


@dataclass(frozen=True)
class _Abreast:
    """Runs of one test side by side, as many as the screen holds without breaking a number."""

    results: Sequence[Result]
    truth_of: dict[int, dict[str, TruthComparison]]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        boundless = console.options.update(max_width=10_000)
        remaining = self.results
        while remaining:
            tables = (_table(remaining[:count], self.truth_of) for count in range(len(remaining), 0, -1))
            fits = (table for table in tables if console.measure(table, options=boundless).maximum <= options.max_width)
            shown = next(fits, _table(remaining[:1], self.truth_of))
            yield shown
            remaining = remaining[len(shown.columns) - 1 :]


def as_tables(
    results: Sequence[Result], truths: Sequence[dict[str, TruthComparison]] = (), *, each: bool = False
) -> RenderableType:
    """A rich table for each test, the truth below a figure where it is known, doubts last.

    A column for each direction, the mean of its runs; for each run where it is asked for or the truth is known, or
    where nothing was repeated."""
    truth_of = {id(result): truth for result, truth in zip(results, truths, strict=False)}
    parts: list[RenderableType] = []
    doubts = [(result, doubt) for result in results for doubt in result.doubts]
    for group in by_test(results):
        together = pooled(group)
        repeated = [means for means in together if means.figures]
        if repeated and not truths:
            parts.append(_means(repeated))
        if each or truths or len(repeated) < len({result.title for result in group}):
            parts.append(_Abreast(group, truth_of))
        each_word = "; ± of single runs with --each" if repeated and not each else ""
        parts.append(Text(what_u_is(group, repeated) + each_word, style="dim"))
        both = pairs_of(group)
        lines = (
            *pairs_in_words(both),
            *lag_in_words(both, group),
            *eccentricities_in_words(group),
            *warmth_in_words(group),
        )
        parts += [Text(line, style="dim") for line in lines]
        doubts += [(result, why) for means in together for result, why in means.left_out]
    if truths:
        parts.append(Text(verdict(truths), style="green" if all_agree(truths) else "bold red"))
    parts += [Text(f"{result.title}, {result.name}: {doubt}", style="yellow") for result, doubt in doubts]
    return Group(*parts)


def _means(repeated: Sequence[Pooled]) -> Table:
    """Means over runs, a column for each direction."""
    rig = repeated[0].runs[0].measured.rig.name
    table = Table(
        title=f"{rig} · mean over runs ± standard uncertainty of the mean", title_style="dim", header_style="bold"
    )
    table.add_column("")
    for mean in repeated:
        table.add_column(_over(mean.title, f"{len(mean.runs)} runs"), justify="right")
    for name in in_order(name for mean in repeated for name in mean.figures):
        cells = [_mean_cell(mean.figures[name]) if name in mean.figures else "" for mean in repeated]
        table.add_row(label(name), *cells, style="bold" if name in LEADING else "")
    return whole(table)


def _mean_cell(figure: BetweenRuns) -> Text:
    return _over(str(figure.mean), f"sd {figure.in_sd} {figure.mean.sign}")


def _over(text: str, below: str, style: str = "dim") -> Text:
    """Return a text with another in its own style below it."""
    return Text.assemble(text, "\n", (below, style))


def _table(group: Sequence[Result], truth_of: dict[int, dict[str, TruthComparison]]) -> Table:
    title = f"{group[0].measured.rig.name} · value ± standard uncertainty"
    table = Table(title=title, title_style="dim", header_style="bold")
    table.add_column("")
    for result in group:
        table.add_column(_over(result.title, result.name), justify="right")
    for name in in_order(name for result in group for name in result.figures):
        cells = [_cell(result, name, truth_of.get(id(result), {})) for result in group]
        table.add_row(label(name), *cells, style="bold" if name in LEADING else "")
    table.add_row("samples", *(str(result.found.samples) for result in group), style="dim")
    if lags := _lags(group):
        table.add_row("time, gauges to robot", *lags, style="dim")
    return whole(table)


def _lags(group: Sequence[Result]) -> list[str]:
    """How well the gauges' time is known against the robot's, where that is known of any run."""
    lag_is_known = any(result.measured.u_lag_s for result in group)
    return [f"± {result.measured.u_lag_s * 1e3:.1f} ms" for result in group] if lag_is_known else []


def _cell(result: Result, name: str, truth: dict[str, TruthComparison]) -> str | Text:
    figure = result.figures.get(name)
    if figure is None:
        return ""
    if name not in truth:
        return str(figure)
    comparison = truth[name]
    colour = "green" if abs(comparison.deviation_u) <= 2 else "red"
    return _over(str(figure), f"truth {figure.rounded(comparison.truth)} ({comparison.deviation_u:+.1f}u)", colour)

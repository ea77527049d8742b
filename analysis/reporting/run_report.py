"""What people and scripts read of analysed runs: tables and the JSON object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.table import Table
from rich.text import Text

from analysis.frames import for_json
from analysis.measures.link_angle import CircleResult
from analysis.measures.pooled import ONE_RUN, BetweenRuns, Pairs, Pooled, pairs_of, pooled
from analysis.measures.quantity import Quantity
from analysis.measures.results import Result, by_test
from analysis.reporting.labels import LEADING, in_order, label
from analysis.reporting.truth import TruthComparison, all_agree, verdict
from analysis.reporting.wide_tables import whole


@dataclass(frozen=True)
class _Abreast:
    """Runs of one test side by side, as many as the screen holds without breaking a number."""

    results: Sequence[Result]
    known: dict[int, dict[str, TruthComparison]]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        boundless = console.options.update(max_width=10_000)
        rest = self.results
        while rest:
            tables = (_table(rest[:count], self.known) for count in range(len(rest), 0, -1))
            fits = (table for table in tables if console.measure(table, options=boundless).maximum <= options.max_width)
            shown = next(fits, _table(rest[:1], self.known))
            yield shown
            rest = rest[len(shown.columns) - 1 :]


def as_tables(
    results: Sequence[Result], truths: Sequence[dict[str, TruthComparison]] = (), *, each: bool = False
) -> RenderableType:
    """A rich table for each test, the truth below a figure where it is known, doubts last.

    A column for each direction, the mean of its runs; for each run where it is asked for or the truth is known, or
    where nothing was repeated."""
    known = {id(result): truth for result, truth in zip(results, truths, strict=False)}
    parts: list[RenderableType] = []
    doubts = [(result, doubt) for result in results for doubt in result.doubts]
    for group in by_test(results):
        together = pooled(group)
        repeated = [one for one in together if one.figures]
        if repeated and not truths:
            parts.append(_means(repeated))
        if each or truths or len(repeated) < len({result.title for result in group}):
            parts.append(_Abreast(group, known))
        each_word = "; ± of single runs with --each" if repeated and not each else ""
        parts.append(Text(what_u_is(group, repeated) + each_word, style="dim"))
        parts += [Text(line, style="dim") for line in in_words(pairs_of(group), group)]
        doubts += [(result, why) for one in together for result, why in one.left_out]
    if truths:
        parts.append(Text(verdict(truths), style="green" if all_agree(truths) else "bold red"))
    parts += [Text(f"{result.title}, {result.name}: {doubt}", style="yellow") for result, doubt in doubts]
    return Group(*parts)


def what_u_is(group: Sequence[Result], repeated: Sequence[Pooled]) -> str:
    """What the uncertainties of a group mean: of means, and of runs that nothing repeats."""
    if not repeated:
        return ONE_RUN
    runs = " and ".join(f"{len(one.runs)} runs {one.title}" for one in repeated)
    means = f"{runs}: mean ± standard uncertainty of the mean, sd between the runs"
    titles = dict.fromkeys(result.title for result in group)
    alone = [title for title in titles if title not in {one.title for one in repeated}]
    return f"{means}; {' and '.join(alone)}: {ONE_RUN}" if alone else means


def _means(repeated: Sequence[Pooled]) -> Table:
    """Means over runs, a column for each direction."""
    rig = repeated[0].runs[0].measured.rig.name
    table = Table(
        title=f"{rig} · mean over runs ± standard uncertainty of the mean", title_style="dim", header_style="bold"
    )
    table.add_column("")
    for one in repeated:
        table.add_column(_over(one.title, f"{len(one.runs)} runs"), justify="right")
    for name in in_order(name for one in repeated for name in one.figures):
        cells = [_mean_cell(one.figures[name]) if name in one.figures else "" for one in repeated]
        table.add_row(label(name), *cells, style="bold" if name in LEADING else "")
    return whole(table)


def _mean_cell(figure: BetweenRuns) -> Text:
    return _over(str(figure.mean), f"sd {figure.in_sd} {figure.mean.sign}")


def _over(text: str, below: str, style: str = "dim") -> Text:
    """Return a text with another in its own style below it."""
    return Text.assemble(text, "\n", (below, style))


def in_words(both: Pairs | None, group: Sequence[Result]) -> list[str]:
    """acw against cw, the lag of the gauges, and which runs are not a pair, one line each."""
    if not isinstance(group[0].found, CircleResult):
        return []
    if both is None:
        return ["one direction cannot show a lag between gauges and robot: analyse acw and cw together"]
    lines = list(both.refused)
    if both.lag is not None:
        figures = "; ".join(f"{label(name).strip()} {both.figures[name]}" for name in in_order(both.figures))
        count = f" ({len(both.runs)} pairs)" if len(both.runs) > 1 else ""
        lines += [f"acw against cw{count}: {figures}", _of_lag(both.lag, _rate(both))]
    return lines


def _rate(both: Pairs) -> float:
    """How fast the circle was driven, rad/s."""
    found = both.runs[0][0].found
    return abs(found.curve.rate) if isinstance(found, CircleResult) else 0.0


def _of_lag(lag: Quantity, rate: float) -> str:
    if abs(lag.value) < 2 * lag.u:
        return f"a lag of the gauges behind the robot is not detected: {lag}"
    turned = np.degrees(rate * abs(lag.value) / 1000)
    return (
        f"the gauges lag the robot by {lag}: the shifts of acw and cw are off by {turned:.2g}° in opposite directions, "
        "which their u does not include; describe the gauge by `timing` in the rig file, or run rig diagnose"
    )


def _table(group: Sequence[Result], known: dict[int, dict[str, TruthComparison]]) -> Table:
    title = f"{group[0].measured.rig.name} · value ± standard uncertainty"
    table = Table(title=title, title_style="dim", header_style="bold")
    table.add_column("")
    for result in group:
        table.add_column(_over(result.title, result.name), justify="right")
    for name in in_order(name for result in group for name in result.figures):
        cells = [_cell(result, name, known.get(id(result), {})) for result in group]
        table.add_row(label(name), *cells, style="bold" if name in LEADING else "")
    table.add_row("samples", *(str(result.found.samples) for result in group), style="dim")
    if lags := _lags(group):
        table.add_row("time, gauges to robot", *lags, style="dim")
    return whole(table)


def _lags(group: Sequence[Result]) -> list[str]:
    """How well the gauges' time is known against the robot's, where that is known of any run."""
    known = any(result.measured.u_lag_s for result in group)
    return [f"± {result.measured.u_lag_s * 1e3:.1f} ms" for result in group] if known else []


def _cell(result: Result, name: str, truth: dict[str, TruthComparison]) -> str | Text:
    figure = result.figures.get(name)
    if figure is None:
        return ""
    if name not in truth:
        return str(figure)
    known = truth[name]
    colour = "green" if abs(known.deviation_u) <= 2 else "red"
    return _over(str(figure), f"truth {figure.rounded(known.truth)} ({known.deviation_u:+.1f}u)", colour)


def as_object(results: Sequence[Result], truths: Sequence[dict[str, TruthComparison]] = ()) -> dict[str, Any]:
    """The same for scripts; angles in degrees, lengths in mm, u the standard uncertainty, null where it is unknown."""
    runs = [result.to_dict() for result in results]
    for run, truth in zip(runs, truths, strict=False):
        run["truth"] = {name: asdict(comparison) for name, comparison in truth.items()}
    groups = by_test(results)
    plain: dict[str, Any] = for_json(
        {
            "runs": runs,
            "between_runs": [_pooled_object(one) for group in groups for one in pooled(group)],
            "remarks": [what_u_is(group, [one for one in pooled(group) if one.figures]) for group in groups],
            "acw_against_cw": [_pairs_object(both, group) for group in groups if (both := pairs_of(group))],
        }
    )
    return plain


def _pooled_object(one: Pooled) -> dict[str, Any]:
    """u of the mean, sd between the runs: what no single run can show."""
    every = one.runs or tuple(result for result, _ in one.left_out)
    return {
        "rig": every[0].measured.rig.name,
        "test": every[0].test,
        "direction": every[0].measured.run.manifest.direction,
        "runs": [str(result.measured.path) for result in one.runs],
        "left_out": {str(result.measured.path): why for result, why in one.left_out},
        "figures": {name: _between_object(figure) for name, figure in one.figures.items()},
    }


def _between_object(figure: BetweenRuns | Quantity) -> dict[str, Any]:
    if isinstance(figure, Quantity):
        return asdict(figure)
    return asdict(figure.mean) | {"sd_between_runs": figure.sd, "runs": figure.runs}


def _pairs_object(both: Pairs, group: Sequence[Result]) -> dict[str, Any]:
    return {
        "rig": group[0].measured.rig.name,
        "test": group[0].test,
        "runs": [str(result.measured.path) for acw_and_cw in both.runs for result in acw_and_cw],
        "figures": {name: _between_object(figure) for name, figure in both.figures.items()},
        "lag": None if both.lag is None else asdict(both.lag),
        "refused": list(both.refused),
    }

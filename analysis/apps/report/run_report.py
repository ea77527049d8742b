"""Tables of analysed runs, with remarks on uncertainties and directions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.table import Table
from rich.text import Text

from analysis.apps.report.run_object import (
    TruthComparison,
    all_agree,
    eccentricities_in_words,
    lag_in_words,
    pairs_in_words,
    similar_once,
    verdict,
    warmth_in_words,
    what_u_is,
)
from analysis.apps.report.texts import LEADING, in_order, label
from analysis.cli.plain_console import fold_long_words, right
from analysis.procedures.pooled import Pooled, pairs_of, pooled
from analysis.procedures.results import Result, by_test


@dataclass(frozen=True)
class _Abreast:
    """Table of runs of a test in columns, split into several tables if they do not fit on the screen."""

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
    """Return a table for each test, with the truth below a figure if known, and doubts at the end.

    A column contains the mean over the runs of a direction. Each run has a column if `each` is set, if the truth is
    known, or if no run was repeated.
    """
    truth_of = {id(result): truth for result, truth in zip(results, truths, strict=False)}
    parts: list[RenderableType] = []
    doubts = [(result, doubt) for result in results for doubt in result.doubts]
    for group in by_test(results):
        together = pooled(group)
        repeated = [means for means in together if means.figures]
        if repeated and not truths:
            parts.append(_table_of_means(repeated))
        if each or truths or len(repeated) < len({result.title for result in group}):
            parts.append(_Abreast(group, truth_of))
        each_word = "; --each shows the single runs" if repeated and not each else ""
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
    runs_of_doubt: dict[str, list[str]] = {}
    for result, doubt in doubts:
        runs_of_doubt.setdefault(doubt, []).append(f"{result.title}, {result.name}")
    parts += [Text(f"{names}: {doubt}", style="yellow") for doubt, names in similar_once(runs_of_doubt)]
    return Group(*parts)


def _table_of_means(repeated: Sequence[Pooled]) -> Table:
    """Return a table of means over runs, a column for each direction."""
    rig = repeated[0].runs[0].measured.rig.name
    title = f"{rig} · mean over runs ± standard uncertainty of the mean"
    columns = (right(_stack_texts(mean.title, f"{len(mean.runs)} runs")) for mean in repeated)
    table = Table("", *columns, title=title, title_style="dim", header_style="bold")
    for name in in_order(name for mean in repeated for name in mean.figures):
        figures = [mean.figures.get(name) for mean in repeated]
        cells = [
            _stack_texts(str(figure.mean), f"sd {figure.in_sd} {figure.mean.sign}") if figure else ""
            for figure in figures
        ]
        table.add_row(label(name), *cells, style="bold" if name in LEADING else "")
    return fold_long_words(table)


def _stack_texts(text: str, below: str, style: str = "dim") -> Text:
    """Return a text with a second text below, in a different style."""
    return Text.assemble(text, "\n", (below, style))


def _table(group: Sequence[Result], truth_of: dict[int, dict[str, TruthComparison]]) -> Table:
    title = f"{group[0].measured.rig.name} · value ± standard uncertainty"
    columns = (right(_stack_texts(result.title, result.name)) for result in group)
    table = Table("", *columns, title=title, title_style="dim", header_style="bold")
    for name in in_order(name for result in group for name in result.figures):
        cells: list[str | Text] = []
        for result in group:
            figure, comparison = result.figures.get(name), truth_of.get(id(result), {}).get(name)
            cell: str | Text = "" if figure is None else str(figure)
            if figure is not None and comparison is not None:
                true = f"truth {figure.rounded(comparison.truth)} ({comparison.deviation_u:+z.1f}u)"
                cell = _stack_texts(str(figure), true, "green" if abs(comparison.deviation_u) <= 2 else "red")
            cells.append(cell)
        table.add_row(label(name), *cells, style="bold" if name in LEADING else "")
    table.add_row("samples", *(str(result.found.samples) for result in group), style="dim")
    if any(result.measured.u_lag_s for result in group):  # uncertainty of the time of the gauges relative to the robot
        lags = (f"± {result.measured.u_lag_s * 1e3:.1f} ms" for result in group)
        table.add_row("time, gauges to robot", *lags, style="dim")
    return fold_long_words(table)

"""Picture files of evaluated runs: the charts of the page, a sheet for each test on circles and each run at targets."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from matplotlib.figure import Figure

from analysis.apps.report.chart import Picture
from analysis.apps.report.run_charts import circle_charts, raw_charts, target_charts
from analysis.apps.report.still_chart import as_png, sheet_of
from analysis.apps.report.texts import LEADING, label, texts_of
from analysis.procedures.circle import CircleResult
from analysis.procedures.results import Result, by_test


def save_all_pictures(results: Sequence[Result], directory: Path) -> list[Path]:
    from analysis.runs.written_files import write_views  # noqa: PLC0415 - slow to import

    texts, figures = texts_of("en"), dict[str, Callable[[], Figure]]()
    for group in by_test(results):  # one test on one rig, both part of the file name
        rig = group[0].measured.rig.name
        stem = f"{rig}-{group[0].test}"
        if isinstance(group[0].found, CircleResult):
            title = f"{texts.test(group[0].test)} · {rig}"
            for kind, charts in (("raw", raw_charts), ("error", circle_charts)):
                figures[f"{stem}-{kind}.png"] = partial(_circles, title, charts, group)
        else:
            for name, result in distinctly_named(group):
                figures[f"{stem}-{name}.png"] = partial(_targets, result)
    return write_views(directory, {name: as_png(figure) for name, figure in figures.items()})


def distinctly_named(results: Sequence[Result]) -> list[tuple[str, Result]]:
    """Names of results; equal names, from different directories, are numbered."""
    names = [result.name for result in results]
    return [
        (name if names.count(name) == 1 else f"{name}-{place}", result)
        for place, (name, result) in enumerate(zip(names, results, strict=True), start=1)
    ]


def _circles(title: str, charts: Callable[..., Sequence[Picture]], group: Sequence[Result]) -> Figure:
    return sheet_of([title], charts(group, texts_of("en")))


def _targets(result: Result) -> Figure:
    figures = [f"{label(name).strip()} {result.figures[name]}" for name in result.figures if name in LEADING]
    title = f"{result.title} · {result.measured.rig.name} · {result.name}"
    return sheet_of([title, *figures], target_charts(result, texts_of("en")))

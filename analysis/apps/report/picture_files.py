"""Picture files: a sheet for each test on circles and each run at targets."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import BinaryIO

from analysis.apps.report.chart import (
    as_png,
    sheet_of,
)
from analysis.apps.report.run_charts import circle_charts, raw_charts, target_charts
from analysis.apps.report.texts import ENGLISH, LEADING
from analysis.procedures.circle import CircleResult
from analysis.procedures.results import Result, by_test


def save_all_pictures(results: Sequence[Result], directory: Path) -> list[Path]:
    from analysis.runs.written_files import write_views  # noqa: PLC0415 - slow to import

    files = dict[str, Callable[[BinaryIO], None]]()
    for group in by_test(results):  # one test on one rig, both part of the file name
        rig = group[0].measured.rig.name
        stem = f"{rig}-{group[0].test}"
        if isinstance(group[0].found, CircleResult):
            title = f"{ENGLISH.test(group[0].test)} · {rig}"
            for kind, charts in (("raw", raw_charts), ("error", circle_charts)):
                files[f"{stem}-{kind}.png"] = as_png(partial(sheet_of, [title], charts(group, ENGLISH)))
            continue
        for name, result in distinctly_named(group):
            figures = [
                f"{ENGLISH.label(key).strip()} {figure}" for key, figure in result.figures.items() if key in LEADING
            ]
            lines = [f"{result.title} · {rig} · {result.name}", *figures]
            files[f"{stem}-{name}.png"] = as_png(partial(sheet_of, lines, target_charts(result, ENGLISH)))
    return write_views(directory, files)


def distinctly_named(results: Sequence[Result]) -> list[tuple[str, Result]]:
    """Names of results; equal names, from different directories, are numbered."""
    names = [result.name for result in results]
    return [
        (name if names.count(name) == 1 else f"{name}-{place}", result)
        for place, (name, result) in enumerate(zip(names, results, strict=True), start=1)
    ]

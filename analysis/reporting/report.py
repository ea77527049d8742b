"""What people and scripts read: tables, the JSON object and the HTML report of analysed runs."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from analysis.reporting.for_json import for_json
from analysis.reporting.labels import LEADING, in_order, label
from analysis.reporting.results import Result, by_test, pair_of
from analysis.reporting.truth import Comparison, all_agree, verdict
from analysis.tests.circle import CircleResult
from analysis.tests.pair import Pair
from rigs.errors import FileError

_ABREAST = 3
"""Runs side by side that a narrow screen holds without cutting a number."""


def as_tables(results: Sequence[Result], truths: Sequence[dict[str, Comparison]] = ()) -> RenderableType:
    """A rich table for each test, a column for each run, the truth below a figure where it is known, doubts last."""
    known = {id(result): truth for result, truth in zip(results, truths, strict=False)}
    parts: list[RenderableType] = []
    for group in by_test(results):
        parts += [_table(group[k : k + _ABREAST], known) for k in range(0, len(group), _ABREAST)]
        both = pair_of(group)
        if both:
            told = "; ".join(f"{label(name).strip()} {both.figures[name]}" for name in in_order(both.figures))
            parts.append(Text(f"acw against cw: {told}", style="dim"))
        if any(isinstance(result.found, CircleResult) for result in group):
            parts.append(Text(lag_in_words(both), style="dim"))
    if truths:
        parts.append(Text(verdict(truths), style="green" if all_agree(truths) else "bold red"))
    parts += [
        Text(f"{result.title}, {result.name}: {doubt}", style="yellow") for result in results for doubt in result.doubts
    ]
    return Group(*parts)


def lag_in_words(both: Pair | None) -> str:
    """What two directions tell of the gauges' time, and that one direction tells nothing."""
    if both is None:
        return "a lag between gauges and robot cannot be told from one direction: analyse acw and cw together"
    if abs(both.lag.value) < 2 * both.lag.u:
        return f"no lag of the gauges behind the robot is to be seen: {both.lag}"
    return f"gauges lag the robot by {both.lag} (not taken out)"


def _table(group: Sequence[Result], known: dict[int, dict[str, Comparison]]) -> Table:
    title = f"{group[0].measured.rig.name} · value ± standard uncertainty"
    table = Table(title=title, title_style="dim", header_style="bold")
    table.add_column("")
    for result in group:
        table.add_column(f"{result.title}\n[dim]{result.name}[/dim]", justify="right")
    for name in in_order(name for result in group for name in result.figures):
        cells = [_cell(result, name, known.get(id(result), {})) for result in group]
        table.add_row(label(name), *cells, style="bold" if name in LEADING else "")
    table.add_row("samples", *(str(result.found.samples) for result in group), style="dim")
    if any(result.measured.u_lag_s for result in group):
        lags = (f"± {result.measured.u_lag_s * 1e3:.1f} ms" for result in group)
        table.add_row("time, gauges to robot", *lags, style="dim")
    return table


def _cell(result: Result, name: str, truth: dict[str, Comparison]) -> str:
    figure = result.figures.get(name)
    if figure is None:
        return ""
    if name not in truth:
        return str(figure)
    known = truth[name]
    colour = "green" if abs(known.deviation_u) <= 2 else "red"
    return f"{figure}\n[{colour}]truth {figure.rounded(known.truth)} ({known.deviation_u:+.1f}u)[/{colour}]"


def as_object(results: Sequence[Result], truths: Sequence[dict[str, Comparison]] = ()) -> dict[str, Any]:
    """The same for scripts; angles in degrees, lengths in mm, u the standard uncertainty, null where nobody knows."""
    runs = [_run_object(result) for result in results]
    for run, truth in zip(runs, truths, strict=False):
        run["truth"] = {name: asdict(comparison) for name, comparison in truth.items()}
    reversing = [
        {
            "rig": group[0].measured.rig.name,
            "test": group[0].test,
            "figures": {name: asdict(figure) for name, figure in both.figures.items()},
            "lag": asdict(both.lag),
        }
        for group in by_test(results)
        if (both := pair_of(group))
    ]
    plain: dict[str, Any] = for_json({"runs": runs, "acw_against_cw": reversing})
    return plain


def _run_object(result: Result) -> dict[str, Any]:
    manifest = result.measured.run.manifest
    return {
        "run": str(result.measured.path),
        "name": manifest.name,
        "rig": result.measured.rig.name,
        "test": manifest.test,
        "direction": manifest.direction,
        "started": manifest.started,
        "samples": result.found.samples,
        "u_lag_s": result.measured.u_lag_s,
        "figures": {name: asdict(figure) for name, figure in result.figures.items()},
        "doubts": list(result.doubts),
    }


def write_report(results: Sequence[Result], directory: Path) -> Path:
    """Pictures and report.html, which needs no other file. Raises FileError where nothing can be written."""
    from jinja2 import Environment, PackageLoader, StrictUndefined  # noqa: PLC0415 - slow, needed here only

    from analysis.reporting.plots import save_pictures  # noqa: PLC0415

    environment = Environment(loader=PackageLoader("analysis"), autoescape=True, undefined=StrictUndefined)
    environment.filters["label"] = label
    report = directory / "report.html"
    try:
        directory.mkdir(parents=True, exist_ok=True)
        sections = [
            {
                "results": group,
                "names": in_order(name for result in group for name in result.figures),
                "pair": (both := pair_of(group)),
                "lag": lag_in_words(both),
                "pictures": [base64.b64encode(path.read_bytes()).decode() for path in save_pictures(group, directory)],
            }
            for group in by_test(results)
        ]
        html = environment.get_template("report.html").render(sections=sections, leading=LEADING)
        report.write_text(html, encoding="utf-8")
    except OSError as error:
        raise FileError(str(directory), error.strerror or str(error), "give another --plot") from None
    return report

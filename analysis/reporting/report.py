"""What people and scripts read: tables, the JSON object and the HTML report of analysed runs."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.table import Table
from rich.text import Text

from analysis.reporting.for_json import for_json
from analysis.reporting.labels import LEADING, in_order, label
from analysis.reporting.results import Result, by_test, pair_of, paired
from analysis.reporting.truth import Comparison, all_agree, verdict
from analysis.reporting.whole import whole
from analysis.tests.circle import CircleResult
from analysis.tests.pair import Pair
from rigs.errors import FileError


@dataclass(frozen=True)
class _Abreast:
    """Runs of one test side by side, as many as the screen holds without breaking a number."""

    results: Sequence[Result]
    known: dict[int, dict[str, Comparison]]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        boundless = console.options.update(max_width=10_000)
        rest = self.results
        while rest:
            tables = (_table(rest[:count], self.known) for count in range(len(rest), 0, -1))
            fits = (table for table in tables if console.measure(table, options=boundless).maximum <= options.max_width)
            shown = next(fits, _table(rest[:1], self.known))
            yield shown
            rest = rest[len(shown.columns) - 1 :]


def as_tables(results: Sequence[Result], truths: Sequence[dict[str, Comparison]] = ()) -> RenderableType:
    """A rich table for each test, a column for each run, the truth below a figure where it is known, doubts last."""
    known = {id(result): truth for result, truth in zip(results, truths, strict=False)}
    parts: list[RenderableType] = []
    for group in by_test(results):
        parts.append(_Abreast(group, known))
        both = pair_of(group)
        if both:
            told = "; ".join(f"{label(name).strip()} {both.figures[name]}" for name in in_order(both.figures))
            parts.append(Text(f"acw against cw{which_of(group)}: {told}", style="dim"))
        if any(isinstance(result.found, CircleResult) for result in group):
            parts.append(Text(lag_in_words(both), style="dim"))
    if truths:
        parts.append(Text(verdict(truths), style="green" if all_agree(truths) else "bold red"))
    parts += [
        Text(f"{result.title}, {result.name}: {doubt}", style="yellow") for result in results for doubt in result.doubts
    ]
    return Group(*parts)


def which_of(group: Sequence[Result]) -> str:
    """Which two runs are held against each other, where there are more: ` (monday-acw, monday-cw)`."""
    both = paired(group)
    return f" ({both[0].name}, {both[1].name})" if both and len(group) > 2 else ""


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
    if lags := _lags(group):
        table.add_row("time, gauges to robot", *lags, style="dim")
    return whole(table)


def _lags(group: Sequence[Result]) -> list[str]:
    """How well the gauges' time is known against the robot's, where that is known of any run."""
    known = any(result.measured.u_lag_s for result in group)
    return [f"± {result.measured.u_lag_s * 1e3:.1f} ms" for result in group] if known else []


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
            "runs": [str(result.measured.path) for result in paired(group) or ()],
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
                "which": which_of(group),
                "time": _lags(group),
                "lag": lag_in_words(both) if isinstance(group[0].found, CircleResult) else "",
                "pictures": [base64.b64encode(path.read_bytes()).decode() for path in save_pictures(group, directory)],
            }
            for group in by_test(results)
        ]
        html = environment.get_template("report.html").render(sections=sections, leading=LEADING)
        report.write_text(html, encoding="utf-8")
    except OSError as error:
        raise FileError(str(directory), error.strerror or str(error), "give another --plot") from None
    return report

"""What people and scripts read: the table, the JSON object and the HTML report of analysed runs."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from analysis.results import Result
from analysis.truth import Comparison, verdict
from rigs.errors import FileError

LABELS = {
    "band_deg": "error band",
    "amplitude_deg": "sine amplitude r",
    "shift_deg": "sine shift α",
    "offset_deg": "sine offset A",
    "eccentricity_mm": "eccentricity",
    "eccentricity_u_mm": "  along u (φ = 0°)",
    "eccentricity_v_mm": "  along v (φ = 90°)",
}


def as_table(results: Sequence[Result], truths: Sequence[dict[str, Comparison]] = ()) -> RenderableType:
    """A rich table, a column for each run, beside it the truth where it is known, doubts below."""
    table = Table(title="value ± standard uncertainty", title_style="dim", header_style="bold")
    table.add_column("")
    for result in results:
        table.add_column(f"{result.title}\n[dim]{result.data.run.manifest.name}[/dim]", justify="right")
    for name, label in LABELS.items():
        table.add_row(label, *_cells(name, results, truths), style="bold" if name == "band_deg" else "")
    for label, cells in _circumstances(results).items():
        table.add_row(label, *cells, style="dim")
    doubts = [Text(f"{result.title}: {doubt}", style="yellow") for result in results for doubt in result.doubts]
    agreement = [Text(verdict(truths), style="green")] if truths else []
    return Group(table, *agreement, *doubts)


def _cells(name: str, results: Sequence[Result], truths: Sequence[dict[str, Comparison]]) -> list[str]:
    cells = []
    for place, result in enumerate(results):
        figure = result.yaw.figures[name]
        cell = str(figure)
        if truths:
            truth = truths[place][name]
            cell += f"\n[green]truth {figure.rounded(truth.truth)} ({truth.deviation_u:+.1f} u)[/green]"
        cells.append(cell)
    return cells


def _circumstances(results: Sequence[Result]) -> dict[str, list[str]]:
    return {
        "samples in the lap": [str(len(result.yaw.phi)) for result in results],
        "noise of the angle": [f"{result.yaw.noise_deg:.5f} °" for result in results],
        "time, gauges to robot": [f"± {result.data.u_lag_s * 1e3:.1f} ms" for result in results],
    }


def as_object(results: Sequence[Result], truths: Sequence[dict[str, Comparison]] = ()) -> dict[str, Any]:
    """The same for scripts; angles in degrees, lengths in mm, u the standard uncertainty."""
    runs = [_run_object(result) for result in results]
    for run, truth in zip(runs, truths, strict=False):
        run["truth"] = {name: asdict(comparison) for name, comparison in truth.items()}
    return {"runs": runs}


def _run_object(result: Result) -> dict[str, Any]:
    manifest = result.data.run.manifest
    return {
        "run": str(result.data.path),
        "name": manifest.name,
        "rig": result.data.rig.name,
        "test": manifest.test,
        "direction": result.yaw.lap.direction,
        "started": manifest.started,
        "samples": len(result.yaw.phi),
        "noise_deg": result.yaw.noise_deg,
        "u_lag_s": result.data.u_lag_s,
        "figures": {name: asdict(figure) for name, figure in result.yaw.figures.items()},
        "left_out": result.data.left_out,
        "faults": result.data.faults,
        "doubts": result.doubts,
    }


def write_report(results: Sequence[Result], directory: Path) -> Path:
    """Pictures and report.html, which needs no other file. Raises FileError where nothing can be written."""
    from jinja2 import Environment, PackageLoader, StrictUndefined  # noqa: PLC0415 - slow, needed here only

    from analysis.plots import save_pictures  # noqa: PLC0415

    environment = Environment(loader=PackageLoader("analysis"), autoescape=True, undefined=StrictUndefined)
    report = directory / "report.html"
    try:
        directory.mkdir(parents=True, exist_ok=True)
        pictures = [base64.b64encode(path.read_bytes()).decode() for path in save_pictures(results, directory)]
        html = environment.get_template("report.html").render(results=results, labels=LABELS, pictures=pictures)
        report.write_text(html, encoding="utf-8")
    except OSError as error:
        raise FileError(str(directory), error.strerror or str(error), "give another --plot") from None
    return report

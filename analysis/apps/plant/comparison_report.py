"""Tables, JSON and pictures of measured and simulated runs."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from analysis.apps.report.diagnosis_picture import disagreement_picture
from analysis.apps.report.diagnosis_screen import places_table
from analysis.apps.report.model_charts import compared_chart
from analysis.apps.report.run_pictures import distinctly_named
from analysis.apps.report.stairs import stairs_of_model, stairs_table
from analysis.apps.report.still_chart import Sheet, as_png, part_of
from analysis.apps.report.texts import LEADING, in_order, label, texts_of
from analysis.cli.plain_console import fold_long_words, right
from analysis.diagnosis.judge.comparison import Compared, Comparison

if TYPE_CHECKING:
    from analysis.runs.written_files import Writer


def as_tables(compared: Compared) -> RenderableType:
    """Return a table for each run with measured, simulated and difference of each figure, then remarks and set-ups."""
    doubts = [Text(doubt, style="yellow") for doubt in compared.doubts]
    poses = [
        Text(
            f"{run_poses.run}: {run_poses.poses} poses, unexplained {run_poses.rms_um:.1f} µm rms, "
            f"at most {run_poses.largest_um:.1f} µm"
        )
        for run_poses in compared.poses
    ]
    tables = []
    for comparison in compared.runs:
        figures, simulated = comparison.result.found.figures, comparison.simulated.figures
        title = f"{comparison.result.title} · {comparison.result.name}"
        numbers = map(right, ("measured", "simulated", "difference"))
        table = Table("", *numbers, title=title, header_style="bold", title_style="bold")
        for name in in_order(figures.keys() & simulated.keys()):
            figure, value = figures[name], simulated[name].value
            cells = (str(figure), figure.rounded(value), figure.rounded(figure.value - value))
            table.add_row(label(name), *cells, style="bold" if name in LEADING else "")
        table.add_row("correlation of the curves", "", f"{comparison.correlation:z.4f}", "")
        table.add_row("unexplained, rms of the readings", "", f"{comparison.rms_um:.2f} µm", "")
        tables.append(fold_long_words(table))
    where: list[RenderableType] = []
    # the model of all runs with the fitted set-ups, and the residual after each of the effects
    if compared.disagreement is not None:
        where = [Text("\nWhere model and readings disagree", style="bold"), *places_table(compared.disagreement.where)]
        if stairs := stairs_of_model(compared.disagreement):
            where += [Text("\nHow much of the error each part explains", style="bold"), stairs_table(stairs)]
        where.append(Text())
    lines = []
    for name, setup in compared.setups.items():
        ball, zeros = np.round(setup.ball, 3).tolist(), np.round(setup.zeros_mm, 4).tolist()
        lines.append(Text(f"set-up {name}: ball at {ball} mm, zeros {zeros} mm (fitted)", style="dim"))
    return Group(*tables, *poses, *where, *doubts, *lines)


def save_pictures(compared: Compared, directory: Path) -> list[Path]:
    """Save a picture of each run, and a summary of the disagreement of all runs at each step of the staircase.

    Raises FileError.
    """
    from analysis.runs.written_files import write_views  # noqa: PLC0415 - slow to import

    named = distinctly_named([comparison.result for comparison in compared.runs])
    pictures = zip(named, compared.runs, strict=True)
    files: dict[str, Writer] = {
        f"{name}-compared.png": as_png(partial(_figure, comparison)) for (name, _), comparison in pictures
    }
    if compared.disagreement is not None:
        files["where.png"] = as_png(partial(disagreement_picture, compared.disagreement), dpi=130)
    return write_views(directory, files)


def _figure(comparison: Comparison) -> Figure:
    """Draw measured and simulated values, and below the difference."""
    chart = compared_chart([comparison], [], texts_of("en"))
    measured, simulated = chart.lines
    difference = replace(measured, name="difference", role="quiet", y=measured.y - simulated.y)
    below = replace(chart, title="Measured less simulated", caption="", lines=(difference,))
    title = f"{comparison.result.title} · {comparison.result.name}: measured and simulated"
    parts = [part_of(chart, f", correlation {comparison.correlation:z.3f}"), part_of(below)]
    return Sheet.of_parts([title], parts, 9.0)

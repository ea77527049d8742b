"""Tables, JSON and pictures of measured and simulated runs."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from analysis.apps.report.blocks import Block, Heading, Row, Sentence, Table, paragraphs
from analysis.apps.report.chart import as_png, sheet_of
from analysis.apps.report.diagnosis_answer import places_blocks, stairs_of_model, stairs_table
from analysis.apps.report.diagnosis_picture import disagreement_picture
from analysis.apps.report.model_charts import compared_chart
from analysis.apps.report.picture_files import distinctly_named
from analysis.apps.report.texts import ENGLISH, LEADING, in_order
from analysis.diagnosis.judge.comparison import Compared, Comparison

if TYPE_CHECKING:
    from analysis.runs.written_files import Writer


def comparison_answer(compared: Compared) -> list[Block]:
    blocks = list[Block]()
    for comparison in compared.runs:
        figures, simulated = comparison.result.found.figures, comparison.simulated.figures
        rows = list[Row]()
        for name in (names := in_order(figures.keys() & simulated.keys())):
            figure, value = figures[name], simulated[name].value
            rows.append((ENGLISH.label(name), str(figure), figure.rounded(value), figure.rounded(figure.value - value)))
        rows.append(("correlation of the curves", "", f"{comparison.correlation:z.4f}", ""))
        rows.append(("unexplained, rms of the readings", "", f"{comparison.rms_um:.2f} µm", ""))
        ranks = (*("unusual" if name in LEADING else "" for name in names), "", "")
        columns = ("", "measured", "simulated", "difference")
        blocks.append(Heading(f"{comparison.result.title} · {comparison.result.name}", 3))
        blocks.append(Table(columns, rows, {1, 2, 3}, ranks))
    blocks += [
        Sentence(
            f"{run_poses.run}: {run_poses.poses} poses, unexplained {run_poses.rms_um:.1f} µm rms, "
            f"at most {run_poses.largest_um:.1f} µm"
        )
        for run_poses in compared.poses
    ]
    # the model of all runs with the fitted set-ups, and the residual after each of the effects
    if compared.disagreement is not None:
        blocks += [Heading(ENGLISH("where_heading")), *places_blocks(compared.disagreement.where)]
        if stairs := stairs_of_model(compared.disagreement):
            blocks += [Heading(ENGLISH("steps")), stairs_table(stairs, ENGLISH)]
    blocks += paragraphs(compared.doubts, "doubt")
    for name, setup in compared.setups.items():
        ball, zeros = np.round(setup.ball, 3).tolist(), np.round(setup.zeros_mm, 4).tolist()
        blocks.append(Sentence(f"set-up {name}: ball at {ball} mm, zeros {zeros} mm (fitted)", "note"))
    return blocks


def save_pictures(compared: Compared, directory: Path) -> list[Path]:
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
    chart = compared_chart([comparison], [], ENGLISH)
    measured, simulated = chart.lines
    difference = replace(measured, name="difference", role="quiet", y=measured.y - simulated.y)
    below = replace(chart, title="Measured less simulated", caption="", lines=(difference,))
    title = f"{comparison.result.title} · {comparison.result.name}: measured and simulated"
    above = replace(chart, title=f"{chart.title}, correlation {comparison.correlation:z.3f}")
    return sheet_of([title], [above, below])

"""Figures of Oh 2019 drawn from the simulated robot, with published and simulated numbers.

Figures of equipment (1, 2, 9, 12) are omitted. Figures of measurements include all effects of the rig file, those of
the paper's simulations only the effects named there: eccentricity (4), datum errors and backlash (8), gear errors (14).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import SubFigure

from analysis.api import CircleCurve, Result, evaluate
from analysis.apps.paper.published import datum_and_play, gears
from analysis.apps.paper.rows import DIRECTIONS, SCATTER, PaperRow, eccentric, repeats, typical_seed, written
from analysis.apps.report.chart import ChartLine, Part, Picture, as_png, sheet_of
from analysis.apps.report.run_charts import circle_charts, joint_chart, raw_charts, target_charts
from analysis.apps.report.texts import texts_of
from analysis.procedures.simulate import simulated_run
from rigs.effects import Effect
from rigs.rig import Rig
from rigs.schema.vocabulary import Direction, TestName

FIGURES = {
    3: ("yaw-angle", "yaw angle and its least-squares sine"),
    4: ("eccentricity", "angle by an eccentricity of 14.142 mm"),
    5: ("least-squares-sine", "least-squares sine and residual"),
    6: ("yaw-error", "orientation error in yaw, all effects"),
    7: ("joint-angles", "joint angles on the circle"),
    8: ("yaw-simulated", "orientation error in yaw, datum errors and plays"),
    10: ("roll-error", "roll, all effects"),
    11: ("roll-simulated", "roll, mean of cw and acw"),
    13: ("sphere", "radial accuracy, all effects"),
    14: ("sphere-simulated", "radial accuracy, only gear errors"),
    15: ("repeatability", "repeatability"),
}
"""File name and title, by figure number."""
_SECTIONS = {4: "§2.1", 7: "Table 1"}
"""Section or table of the paper whose rows are shown below a figure."""


def charts_of(rig: Rig, rig_text: str) -> dict[int, Sequence[Picture]]:
    """Charts by figure number. Raises FileError if the robot cannot run a test."""
    texts = texts_of("en")

    def run(test: TestName, direction: Direction | None, effects: Sequence[Effect], of: Rig = rig) -> Result:
        return evaluate(simulated_run(of, rig_text, test, direction, None, effects))

    def both(test: TestName, effects: Sequence[Effect]) -> list[Result]:
        return [run(test, direction, effects) for direction in DIRECTIONS]

    yaw, roll = both("yaw", rig.effects), both("roll", rig.effects)
    fitted = yaw[DIRECTIONS.index("cw") : DIRECTIONS.index("cw") + 1]
    seed = typical_seed(repeats(rig, rig.effects))
    curves = [result.curve for result in roll if isinstance(result.curve, CircleCurve)]
    mean = ChartLine("mean", "model", curves[0].phi_deg, np.mean([curve.angle_deg for curve in curves], axis=0))
    (first, *_) = raw_charts(roll, texts)
    return {
        3: raw_charts(yaw, texts),
        4: raw_charts([run("yaw", "acw", (), eccentric(rig))], texts),
        5: [*raw_charts(fitted, texts), circle_charts(fitted, texts)[0]],
        6: circle_charts(yaw, texts)[:1],
        7: [joint_chart(yaw, texts)],
        8: circle_charts(both("yaw", datum_and_play(rig.effects)), texts)[:1],
        10: raw_charts(roll, texts),
        11: [replace(first, title="mean of cw and acw", lines=(mean,))],
        13: target_charts(run("radial", None, rig.effects), texts),
        14: target_charts(run("radial", None, gears(rig.effects)), texts),
        15: target_charts(evaluate(simulated_run(rig, rig_text, "repeatability", None, seed, noise=SCATTER)), texts),
    }


def save(rig: Rig, rig_text: str, rows: Sequence[PaperRow], directory: Path) -> list[Path]:
    from analysis.runs.written_files import write_views  # noqa: PLC0415 - slow to import

    files = {}
    for number, charts in charts_of(rig, rig_text).items():
        name, title = FIGURES[number]
        below = _table([row for row in rows if row.where == _SECTIONS.get(number, f"Fig. {number}")])
        title = f"Figure {number} · {title} · {rig.name}"
        files[f"figure-{number:02d}-{name}.png"] = as_png(partial(sheet_of, [title], charts, [below]))
    return write_views(directory, files)


def _table(rows: Sequence[PaperRow]) -> Part:
    cells = [[row.figure, written(row, row.paper), written(row, row.ours)] for row in rows]
    cells = cells or [["the paper gives no number for this figure", "", ""]]

    def draw(sheet: SubFigure) -> None:
        axes = sheet.subplots()
        axes.set_axis_off()
        head = ["", "paper", "ours"]
        table = axes.table(cells, colLabels=head, colWidths=(0.5, 0.2, 0.2), loc="center", edges="horizontal")
        table.auto_set_font_size(False)
        table.set_fontsize(8)

    return 0.24 * (len(cells) + 1) + 0.1, draw

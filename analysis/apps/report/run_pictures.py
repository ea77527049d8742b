"""Picture files of evaluated runs: circles like figures 3, 6, 8, 10 and 11 of the paper, and the page's charts of
target tests.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure, SubFigure

from analysis.apps.report.chart import Chart, ChartLine, Picture, SphereChart, marks_of
from analysis.apps.report.run_charts import target_charts
from analysis.apps.report.still_chart import Sheet, as_png, part_of
from analysis.apps.report.texts import LEADING, label, texts_of
from analysis.procedures.circle import CircleResult
from analysis.procedures.results import Result, by_test
from analysis.procedures.shared.lap_curve import at_resolution
from analysis.procedures.shared.reduction import PHI
from analysis.procedures.shared.result_curves import PoseCurve
from analysis.robot.kinematics.arm import Array
from rigs.text import counted

_GREY = "#777777"
_PHI_DEG = np.degrees(PHI)
_OF_CUBE = ("ap_mm", "rp_mm", "ad_mm", "rd_mm")
_APART_DEG = 4.0
"""Drawn distance of the readings at a target from the centre, to avoid overlaps."""


def save_all_pictures(results: Sequence[Result], directory: Path) -> list[Path]:
    """Write the pictures of all runs by test, and return the paths. Raises FileError if they cannot be written."""
    from analysis.runs.written_files import write_views  # noqa: PLC0415 - slow to import

    figures: dict[str, Callable[[], Figure]] = {}
    for group in by_test(results):  # one test on one rig, both part of the file name
        stem = f"{group[0].measured.rig.name}-{group[0].test}"
        if isinstance(group[0].found, CircleResult):
            for kind, chart, title in (
                ("raw", raw_chart, f"{group[0].test.capitalize()} angle and least-squares sine"),
                ("error", error_chart, f"Orientation error in {group[0].test}"),
            ):
                figures[f"{stem}-{kind}.png"] = partial(circle_figure, group, title, chart)
            continue
        for name, result in distinctly_named(group):
            pictures = target_charts(result, texts_of("en"))
            is_pose = isinstance(result.curve, PoseCurve)
            cube = [picture for picture in pictures if is_pose and picture.frame == "plane"]
            others = [picture for picture in pictures if not is_pose or picture.frame != "plane"]
            files = ((f"{stem}-{name}.png", others, LEADING), (f"{stem}-{name}-cube.png", cube, _OF_CUBE))
            for file, shown, leading in files:
                if shown:
                    figures[file] = partial(target_figure, result, shown, leading)
    return write_views(directory, {name: as_png(figure) for name, figure in figures.items()})


def distinctly_named(results: Sequence[Result]) -> list[tuple[str, Result]]:
    """Return results by name. Runs with equal names, from different directories, are numbered."""
    names = [result.name for result in results]
    return [
        (name if names.count(name) == 1 else f"{name}-{place}", result)
        for place, (name, result) in enumerate(zip(names, results, strict=True), start=1)
    ]


def circle_figure(results: Sequence[Result], title: str, chart: Callable[[Result, CircleResult], Chart]) -> Figure:
    """Draw a chart for each circle below each other, with a common scale."""
    charts = [chart(result, result.found) for result in results if isinstance(result.found, CircleResult)]
    low, high = (float(end(of.reach[k] for of in charts)) for k, end in enumerate((min, max)))
    parts = [part_of(replace(chart, span=(low, high))) for chart in charts]
    return Sheet.of_parts([f"{title} · {results[0].measured.rig.name}"], parts, 9.0)


def target_figure(result: Result, pictures: Sequence[Picture], leading: Collection[str]) -> Figure:
    """Draw the charts of a target test, with the leading figures in the title."""
    parts = [
        (3.6, partial(_draw_sphere, picture)) if isinstance(picture, SphereChart) else part_of(picture)
        for picture in pictures
    ]
    figures = [f"{label(name).strip()} {result.figures[name]}" for name in result.figures if name in leading]
    return Sheet.of_parts([f"{result.title} · {result.measured.rig.name} · {result.name}", *figures], parts, 9.0)


def _draw_sphere(chart: SphereChart, sheet: SubFigure) -> None:
    """Draw a measured surface as a map of the hemisphere."""
    axes = sheet.subplots()
    azimuth_deg = np.degrees(np.arctan2(chart.targets[:, 1], chart.targets[:, 0]))
    dots = draw_hemisphere(axes, np.degrees(np.arccos(chart.targets[:, 2])), azimuth_deg, 1e3 * chart.deviation_mm)
    sheet.suptitle(chart.title, fontsize=8.5, x=0.01, ha="left")
    sheet.colorbar(dots, ax=axes, label="deviation / µm", shrink=0.8)


def draw_hemisphere(
    axes: Axes, polar_deg: Array, azimuth_deg: Array, values: Array, target: Array | None = None
) -> PathCollection:
    """Draw values (n,) at targets on a hemisphere, seen along the axis, as dots from blue (negative) to red (positive).

    target: target numbers (n,); dots of the same target are drawn next to each other.
    """
    azimuth, turn = np.radians(azimuth_deg), np.linspace(0, 2 * np.pi, 181)
    aside = np.zeros((2, len(values)))
    for number in np.unique(target) if target is not None else ():
        rows = np.flatnonzero(target == number)
        around = 2 * np.pi * np.arange(len(rows)) / len(rows)
        aside[:, rows] = (_APART_DEG if len(rows) > 1 else 0.0) * np.stack([np.sin(around), np.cos(around)])
    for ring in range(30, int(max(polar_deg.max(), 30)) + 1, 30):
        axes.plot(ring * np.cos(turn), ring * np.sin(turn), color="#d8d8d8", lw=0.6, zorder=0)
    axes.set_aspect("equal")
    axes.set_axis_off()
    note: dict[str, Any] = {"transform": axes.transAxes, "fontsize": 7.5, "color": _GREY, "ha": "center", "va": "top"}
    axes.text(0.5, 0.0, "seen along the axis: a ring each 30° of polar angle, azimuth 0° to the right", **note)
    x, y = polar_deg * np.cos(azimuth) + aside[0], polar_deg * np.sin(azimuth) + aside[1]
    largest = max(float(np.abs(values).max()), 1e-9)
    return axes.scatter(
        x, y, c=values, cmap="coolwarm", vmin=-largest, vmax=largest, s=26, edgecolors="#555555", linewidths=0.3
    )


def raw_chart(result: Result, circle: CircleResult) -> Chart:
    """Return a chart of the angle over the circle angle with the least-squares sine (figure 3 of the paper)."""
    many = counted(circle.laps.count, "lap")
    at_deg, whole = np.tile(_PHI_DEG, len(circle.curve.laps)), np.linspace(0, 2 * np.pi, 361)
    lines = (
        ChartLine(
            f"readings, {many}", circle.laps.direction, at_deg, np.degrees(circle.curve.laps).ravel(), points=True
        ),
        ChartLine(
            f"sine, amplitude {circle.figures['amplitude_deg']}", "sixth", np.degrees(whole),
            np.degrees(circle.sine(whole)),
        ),
    )  # fmt: skip
    return _circle_chart(result, circle, f"{result.test} / °", lines)


def error_chart(result: Result, circle: CircleResult) -> Chart:
    """Return a chart of the orientation error with the error band and the joint reversals (figure 6 of the paper).

    If there are several laps, each is shown too.
    """
    each = np.degrees(at_resolution(circle.curve.laps - circle.sine(PHI))) if circle.laps.count > 1 else ()
    laps = tuple(ChartLine("" if k else "each lap", "quiet", _PHI_DEG, lap) for k, lap in enumerate(each))
    mean = ChartLine(
        f"error band {circle.figures['band_deg']}", circle.laps.direction, _PHI_DEG, np.degrees(circle.residual)
    )
    chart = _circle_chart(result, circle, "error / °", (*laps, mean))
    return replace(chart, marks=marks_of([(turn.phi_deg, turn.joint) for turn in result.reversals], texts_of("en")))


def _circle_chart(result: Result, circle: CircleResult, y_label: str, lines: tuple[ChartLine, ...]) -> Chart:
    title = f"{circle.laps.direction} · {result.name}"
    return Chart(title, "", "straight", texts_of("en")("circle_angle"), y_label, "°", lines)

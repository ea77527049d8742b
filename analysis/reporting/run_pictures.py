"""Pictures of evaluated runs as files: the circles run by run, after the paper's figures 3 (raw with the fitted sine),
6, 8, 10 and 11 (orientation error); and all that the page shows of tests at targets."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure, SubFigure

from analysis.kinematics.arm import Array
from analysis.measures.lap_curve import at_resolution
from analysis.measures.link_angle import CircleResult
from analysis.measures.reduction import PHI
from analysis.measures.result_curves import JointReversal, PoseCurve
from analysis.measures.results import Result, by_test
from analysis.reporting.chart import Picture, SphereChart
from analysis.reporting.labels import LEADING, label
from analysis.reporting.run_charts import target_charts
from analysis.reporting.sheet import Sheet, as_png
from analysis.reporting.still_chart import part_of
from analysis.reporting.texts import texts_of

_INK = {"acw": "#d95f02", "cw": "#1f5fa8"}
_GREY = "#777777"
_OF_CUBE = ("ap_mm", "rp_mm", "ad_mm", "rd_mm")
_APART_DEG = 4.0
"""Between the readings at one target and its middle, so that none hides another."""


def save_all_pictures(results: Sequence[Result], directory: Path) -> list[Path]:
    """Write the pictures of all runs, test by test; returns their paths. Raises FileError where nothing can be
    written."""
    from analysis.files.write import write_views  # noqa: PLC0415 - slow to import

    figures: dict[str, Callable[[], Figure]] = {}
    for group in by_test(results):  # of one test on one rig, and named by both
        stem = f"{group[0].measured.rig.name}-{group[0].test}"
        if isinstance(group[0].found, CircleResult):
            figures[f"{stem}-raw.png"] = partial(raw_figure, group)
            figures[f"{stem}-error.png"] = partial(error_figure, group)
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
    """Results by name; runs of one name, from different directories, are numbered."""
    names = [result.name for result in results]
    return [
        (name if names.count(name) == 1 else f"{name}-{place}", result)
        for place, (name, result) in enumerate(zip(names, results, strict=True), start=1)
    ]


def target_figure(result: Result, pictures: Sequence[Picture], leading: Collection[str]) -> Figure:
    """The pictures of a test at targets, and the figures that lead there, by their names."""
    parts = [
        (3.6, partial(_draw_sphere, picture)) if isinstance(picture, SphereChart) else part_of(picture)
        for picture in pictures
    ]
    figures = [f"{label(name).strip()} {result.figures[name]}" for name in result.figures if name in leading]
    return Sheet.of_parts([f"{result.title} · {result.measured.rig.name} · {result.name}", *figures], parts, 9.0)


def _draw_sphere(chart: SphereChart, sheet: SubFigure) -> None:
    """A measured surface as a map of the hemisphere."""
    axes = sheet.subplots()
    azimuth_deg = np.degrees(np.arctan2(chart.targets[:, 1], chart.targets[:, 0]))
    dots = draw_hemisphere(axes, np.degrees(np.arccos(chart.targets[:, 2])), azimuth_deg, 1e3 * chart.deviation_mm)
    sheet.suptitle(chart.title, fontsize=8.5, x=0.01, ha="left")
    sheet.colorbar(dots, ax=axes, label="deviation / µm", shrink=0.8)


def draw_hemisphere(
    axes: Axes, polar_deg: Array, azimuth_deg: Array, values: Array, target: Array | None = None
) -> PathCollection:
    """Values (n,) where targets lie on a hemisphere, seen along its axis, as dots in colours that are blue below 0 and
    red above; those of one target, by its number (n,), side by side."""
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


def raw_figure(results: Sequence[Result]) -> Figure:
    """Angle over circle angle with its least-squares sine, a panel for each run (the paper's figure 3)."""
    test = results[0].test
    figure, panels = _panels(results, f"{test.capitalize()} angle and least-squares sine")
    for circle, axes in zip(_circles(results), panels, strict=True):
        for lap in circle.curve.laps:
            axes.plot(np.degrees(PHI), np.degrees(lap), ".", ms=2, color=_INK[circle.laps.direction])
        laps = "1 lap" if circle.laps.count == 1 else f"{circle.laps.count} laps"
        axes.plot([], [], ".", ms=2, color=_INK[circle.laps.direction], label=f"readings, {laps}")
        whole = np.linspace(0, 2 * np.pi, 361)
        sine = f"sine, amplitude {circle.figures['amplitude_deg']}"
        axes.plot(np.degrees(whole), np.degrees(circle.sine(whole)), "-", lw=1, color="black", label=sine)
        axes.set_ylabel(f"{circle.laps.direction}: {test} / °")
        axes.legend(loc="upper left", fontsize=8, framealpha=0.9)
    return figure


def error_figure(results: Sequence[Result]) -> Figure:
    """Orientation error with its band and the joints' reversals, a panel for each run (figure 6)."""
    figure, panels = _panels(results, f"Orientation error in {results[0].test}")
    # One scale for all panels, with room for the marks above and the band's text below
    errors = np.degrees(np.concatenate([circle.residual for circle in _circles(results)]))
    low, high = float(errors.min()), float(errors.max())
    for result, circle, axes in zip(results, _circles(results), panels, strict=True):
        error = np.degrees(circle.residual)
        for lap in circle.curve.laps if circle.laps.count > 1 else ():
            lap_error = np.degrees(at_resolution(lap - circle.sine(PHI)))
            axes.plot(np.degrees(PHI), lap_error, "-", lw=0.5, color=_INK[circle.laps.direction], alpha=0.4)
        axes.plot(np.degrees(PHI), error, "-", lw=1, color=_INK[circle.laps.direction])
        axes.axhspan(error.min(), error.max(), color=_INK[circle.laps.direction], alpha=0.08, lw=0)
        axes.set_ylim(low - 0.28 * (high - low), high + 0.3 * (high - low))
        axes.set_ylabel(f"{circle.laps.direction}: error / °")
        band = f"error band {circle.figures['band_deg']}"
        axes.text(0.01, 0.04, band, transform=axes.transAxes, fontsize=9, va="bottom")
        mark_reversals(axes, result.reversals)
    return figure


def _panels(results: Sequence[Result], title: str) -> tuple[Figure, list[Axes]]:
    figure = Sheet(9, 1.2 + 2.6 * len(results))
    panels: list[Axes] = list(figure.subplots(len(results), 1, sharex=True, squeeze=False)[:, 0])
    figure.suptitle(f"{title} · {results[0].measured.rig.name}", fontsize=11)
    for result, axes in zip(results, panels, strict=True):
        axes.set_title(result.name, fontsize=8, color=_GREY, loc="right")
        axes.set_xlim(0, 360)
        axes.set_xticks(range(0, 361, 30))
        axes.grid(color="#dddddd", lw=0.5)
        axes.spines[["top", "right"]].set_visible(False)
    panels[-1].set_xlabel("circle angle φ / °")
    return figure, panels


def _circles(results: Sequence[Result]) -> list[CircleResult]:
    return [result.found for result in results if isinstance(result.found, CircleResult)]


def mark_reversals(axes: Axes, turns: Sequence[JointReversal]) -> None:
    """A dashed line where a joint turns back; names of close neighbours take turns in height."""
    previous, step = -100.0, 0
    for turn in turns:
        phi = turn.phi_deg
        step = (step + 1) % 3 if phi - previous < 16 else 0
        axes.axvline(phi, color=_GREY, lw=0.7, ls="--")
        axes.annotate(
            f"{turn.name} {'↓' if turn.upper else '↑'}",
            (phi, 1.0 - 0.085 * step),
            xycoords=("data", "axes fraction"),
            xytext=(-3 if phi > 345 else 2, -2),
            textcoords="offset points",
            fontsize=7.5,
            color=_GREY,
            va="top",
            ha="right" if phi > 345 else "left",
        )
        previous = phi

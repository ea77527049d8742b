"""Pictures of evaluated runs, after the paper's figures: 3 (raw with the fitted sine), 6, 8, 10 and 11 (orientation
error), 13 and 14 (radial), 15 (repeatability); and the poses of a tracker."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from analysis.measures.lap_curve import at_resolution
from analysis.measures.link_angle import CircleResult
from analysis.measures.reduction import PHI
from analysis.measures.result_curves import JointReversal, PathCurve, PoseCurve, RadialCurve, RepeatabilityCurve
from analysis.measures.results import Result, by_test
from analysis.reporting.iso_plots import draw_along, draw_plane
from analysis.reporting.iso_views import PlaneView, cube_view, path_view
from analysis.reporting.sheet import Sheet, as_png

_INK = {"acw": "#d95f02", "cw": "#1f5fa8"}
_GREY = "#777777"
_LEAST_BINS = 20


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
            figures[f"{stem}-{name}.png"] = partial(_other_figure, result)
            view = cube_view(result)
            if view is not None:
                figures[f"{stem}-{name}-cube.png"] = partial(cube_figure, result, view)
    return write_views(directory, {name: as_png(figure) for name, figure in figures.items()})


def distinctly_named(results: Sequence[Result]) -> list[tuple[str, Result]]:
    """Results by name; runs of one name, from different directories, are numbered."""
    names = [result.name for result in results]
    return [
        (name if names.count(name) == 1 else f"{name}-{place}", result)
        for place, (name, result) in enumerate(zip(names, results, strict=True), start=1)
    ]


def _other_figure(result: Result) -> Figure:
    match result.curve:
        case RadialCurve():
            return radial_figure(result, result.curve)
        case RepeatabilityCurve():
            return repeatability_figure(result, result.curve)
        case PoseCurve():
            return pose_figure(result, result.curve)
        case PathCurve():
            return path_figure(result, result.curve)
    raise TypeError(result.test)


def _blank(result: Result, title: str, width: float, height: float) -> Figure:
    figure = Sheet(width, height)
    figure.suptitle(f"{title} · {result.measured.rig.name} · {result.name}", fontsize=11)
    return figure


def radial_figure(result: Result, curve: RadialCurve) -> Figure:
    """Deviation from the least-squares sphere over the hemisphere, and target by target (figure 13)."""
    figure = _blank(result, "Radial error about the least-squares sphere", 11, 4.6)
    deviation = curve.deviation_mm
    around, axes = figure.subplots(1, 2, width_ratios=(1, 1.5), subplot_kw={})
    azimuth = np.radians(curve.azimuth_deg)
    largest = float(np.abs(deviation[curve.used]).max())
    dots = around.scatter(
        curve.polar_deg * np.cos(azimuth),
        curve.polar_deg * np.sin(azimuth),
        c=deviation,
        cmap="coolwarm",
        s=90,
        vmin=-largest,
        vmax=largest,
    )
    for ring in range(30, 91, 30):
        turn = np.linspace(0, 2 * np.pi, 181)
        around.plot(ring * np.cos(turn), ring * np.sin(turn), color="#dddddd", lw=0.6, zorder=0)
        below_the_dot = {"xytext": (0, -6), "textcoords": "offset points"}
        around.annotate(f"{ring}°", (0, -ring), fontsize=7, color=_GREY, ha="center", va="top", **below_the_dot)
    around.set_aspect("equal")
    around.set_axis_off()
    around.set_title("seen along the axis, azimuth 0° to the right", fontsize=9)
    figure.colorbar(dots, ax=around, label="deviation / mm", shrink=0.8)
    axes.errorbar(
        curve.target, deviation, curve.spread_mm / 2, fmt="o", ms=4, lw=0.8, color=_INK["cw"],
        label="mean, with the range over orientations" if "spread_mm" in result.figures else None,
    )  # fmt: skip
    if not curve.used.all():
        axes.plot(curve.target[~curve.used], deviation[~curve.used], "x", color="red", label="left out")
    label_axes(axes, "target", "deviation from the sphere / mm")
    text = f"radius {result.figures['radius_mm']}\nerror band {result.figures['band_mm']}"
    axes.text(0.01, 0.98, text, transform=axes.transAxes, va="top", fontsize=9)
    axes.margins(y=0.22)
    if axes.get_legend_handles_labels()[1]:
        axes.legend(loc="lower left", fontsize=8)
    return figure


def repeatability_figure(result: Result, curve: RepeatabilityCurve) -> Figure:
    """Every reading by target and side of approach (figure 15)."""
    figure = _blank(result, "Repeatability", 8, 4.2)
    axes = figure.subplots()
    targets, place = np.unique(curve.target, return_inverse=True)
    for side, aside, name in (("out", -0.125, "from outside"), ("in", 0.125, "from inside")):
        on_side = curve.approach == side
        ink = _INK["acw" if side == "out" else "cw"]
        axes.plot(place[on_side] + aside, curve.reading_mm[on_side], "o", ms=4, color=ink, alpha=0.8, label=name)
    axes.set_xticks(range(len(targets)), [str(target) for target in targets])
    label_axes(axes, "target", "reading / mm")
    text = f"uni-directional {result.figures['uni_mm']}\nbi-directional {result.figures['bi_mm']}"
    axes.text(0.01, 0.98, text, transform=axes.transAxes, va="top", fontsize=9)
    axes.margins(y=0.25)
    axes.legend(loc="lower right", fontsize=8)
    return figure


def pose_figure(result: Result, curve: PoseCurve) -> Figure:
    """Position error pose by pose, and how often which size."""
    figure = _blank(result, "Position error, base and tool fitted", 10, 4.0)
    along, often = figure.subplots(1, 2, width_ratios=(2, 1), sharey=True)
    error = curve.distance_mm
    along.plot(np.arange(1, len(error) + 1), error, ".", ms=3, color=_INK["cw"])
    label_axes(along, "pose", "position error / mm")
    often.hist(error, bins=max(_LEAST_BINS, len(error) // 25), orientation="horizontal", color=_INK["cw"], alpha=0.7)
    label_axes(often, "poses", "")
    along.text(0.01, 0.98, f"rms {result.figures['rms_mm']}", transform=along.transAxes, va="top", fontsize=9)
    return figure


def cube_figure(result: Result, view: PlaneView) -> Figure:
    """The stops of the cube on its inclined plane, their scatter enlarged."""
    figure = _blank(result, "Poses of the ISO 9283 cube", 6.5, 7.0)
    axes = figure.subplots()
    draw_plane(axes, view, points=True)
    label_axes(axes, "level / mm", "rising / mm")
    names = ("ap_mm", "rp_mm", "ad_mm", "rd_mm")
    text = "\n".join(f"{name[:2].upper()} {result.figures[name]}" for name in names if name in result.figures)
    axes.text(0.02, 0.62, text, transform=axes.transAxes, va="bottom", fontsize=9)
    return figure


def path_figure(result: Result, curve: PathCurve) -> Figure:
    """The paths on the cube's plane, enlarged, and the deviation along each."""
    figure = _blank(result, "Paths of ISO 9283", 11, 5.6)
    plane, along = figure.subplots(1, 2)
    draw_plane(plane, path_view(curve), points=False)
    label_axes(plane, "level / mm", "rising / mm")
    draw_along(along, curve)
    label_axes(along, "way along the path / %", "deviation of the mean / µm")
    return figure


def label_axes(axes: Axes, x: str, y: str) -> None:
    """Name the axes of a panel, with their units, and draw a grid instead of a box."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.grid(color="#dddddd", lw=0.5)
    axes.spines[["top", "right"]].set_visible(False)


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
